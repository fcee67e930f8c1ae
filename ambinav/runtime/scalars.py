"""The type of one number, for functions that take one number or an array."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

Scalar: TypeAlias = float | np.floating[Any] | np.integer[Any]
