"""The parameters of an environment as the kernels read them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.metrics import INSTANT, LOST_SECONDS
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.belief import NUMBERS
from ambinav_envs.simulation.layout import DECLARATIONS, LOCALIZERS, MOTIONS, SETTINGS


def settings_of(p: NavigationParameters) -> NDArray[np.void]:
    """Return the parameters as `SETTINGS`, shape (1,)."""
    robot, people = p.robot, p.people
    settings = np.zeros(1, dtype=SETTINGS)
    values: dict[str, Any] = {
        "dt": p.dt, "radius": robot.radius, "min_speed": p.min_speed,
        "max_speed": robot.max_speed, "max_turn_rate": robot.max_turn_rate,
        "acceleration": robot.acceleration, "turn_acceleration": robot.turn_acceleration,
        "true_odometry": tuple(p.true_odometry.packed),
        "modelled_odometry": tuple(p.odometry.packed),
        "localizer": LOCALIZERS.index(p.localizer), "rounds": p.iterations, "gate": p.gate,
        "start_std": p.start_std, "goal_radius": p.goal_radius,
        "success_radius": p.success_radius,
        "goal_std": math.inf if p.goal_std is None else p.goal_std,
        "slip": p.slip, "slip_radius": p.slip_radius, "obstacles": p.obstacles,
        "scan_time": p.scan_time, "gain_std": p.gain_std, "actuation_std": p.actuation_std,
        "lost_steps": int(LOST_SECONDS / p.dt + INSTANT),
        "max_steps": p.max_steps, "end_when_lost": p.end_when_lost, "gamma": p.gamma,
        "weights": p.weights,
        **{
            f"{name}_column": MOTIONS + p.declare.index(name) if name in p.declare else -1
            for name in DECLARATIONS
        },
        "belief_column": p.columns - NUMBERS if p.belief else -1,
        "declare_steps": max(round(p.declare_seconds / p.dt), 1),
        "help_steps": max(round(p.help_seconds / p.dt), 1),
        "person_radius": people.radius, "person_speed": people.speed,
        "window_cells": p.window_cells, "window_spacing": p.window_spacing,
        "ambiguity_seen": p.ambiguity_seen,
        "waypoint": p.waypoint, "waypoint_distance": p.waypoint_distance,
        "box_least": p.obstacle_sizes[0], "box_most": p.obstacle_sizes[1],
    }  # fmt: skip
    for name, value in values.items():
        settings[name] = value
    return settings
