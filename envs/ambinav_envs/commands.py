"""Conversion between actions and speeds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambinav_envs.parameters import NavigationParameters

Floats = NDArray[np.float64]


def as_commands(actions: Floats, parameters: NavigationParameters) -> Floats:
    """Convert actions to speed (m/s) and turn rate (rad/s), shape (N, 2).

    Args:
        actions: Shape (N, 2), see `spaces.continuous`; what is beyond [-1, 1] is cut off.
        parameters: Parameters of the environment.
    """
    shares = np.clip(actions, -1.0, 1.0)
    least, most, share = parameters.min_speed, parameters.robot.max_speed, shares[:, 0]
    if parameters.zero_rests:
        speed = np.maximum(share, 0.0) * most + np.maximum(-share, 0.0) * least
    else:
        speed = least + 0.5 * (share + 1.0) * (most - least)
    return np.stack([speed, shares[:, 1] * parameters.robot.max_turn_rate], axis=1)


def as_actions(commands: Floats, parameters: NavigationParameters) -> Floats:
    """Convert speeds (m/s) and turn rates (rad/s) to continuous actions, shape (N, 2).

    Speeds that no action asks for give actions beyond [-1, 1], or 0 below standing still where the
    robot does not drive backwards.
    """
    least, most, speed = parameters.min_speed, parameters.robot.max_speed, commands[:, 0]
    if parameters.zero_rests:
        share = np.where(speed < 0.0, speed / -least if least < 0.0 else 0.0, speed / most)
    else:
        share = 2.0 * (speed - least) / (most - least) - 1.0
    return np.stack([share, commands[:, 1] / parameters.robot.max_turn_rate], axis=1)
