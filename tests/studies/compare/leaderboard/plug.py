"""A policy as a user might write one: it turns round and round."""

from __future__ import annotations

from typing import Any

import numpy as np


class Spinner:
    def act(self, observations: Any, starts: Any) -> Any:
        return np.tile(np.float32([-1.0, 0.3]), (len(starts), 1))


def spinner(observation_space: Any, action_space: Any) -> Spinner:
    return Spinner()
