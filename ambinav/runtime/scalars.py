"""What counts as one number where arrays are taken too: one number in, one number out."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np

Scalar: TypeAlias = float | np.floating[Any] | np.integer[Any]
