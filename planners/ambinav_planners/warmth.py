"""Kernels loaded or compiled before a planner's clock starts.

The first call of a kernel after an installation compiles it, which takes longer than a planner is
commonly given; the first call in a process loads it.
"""

from __future__ import annotations

import numpy as np

from ambinav.geometry.collision.sweep import motion_free, pose_free
from ambinav_planners.improve.route import improve
from ambinav_planners.problem import Problem

# A way this long, metres, is improved to load what improves ways.
TRIAL = 0.02

_warm: set[tuple[object, ...]] = set()


def warm_up(problem: Problem) -> None:
    """Call every kernel that planning this problem calls, once in a process for each kind."""
    checker, service = problem.checker, problem.service
    steering = checker.steering
    key = (steering.space, checker.footprint.is_disc, service.has_headings)
    if key in _warm:
        return
    start = np.array(problem.start)
    pose_free(*problem.start, *checker.arrays)
    motion_free(
        steering.kind, steering.kernel_radius, *problem.start, *problem.start, *checker.arrays
    )
    steering.lengths(start[np.newaxis], start[np.newaxis])
    for angle in (start[2], start[2] + np.pi, *np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)):
        end = start + TRIAL * np.array([np.cos(angle), np.sin(angle), 0.0])
        way = np.stack([start, end])
        if checker.poses_free(way).all() and checker.motions_free(way[:1], way[1:])[0]:
            improve(way, service, checker)
            service.route_exposure(way, steering)
            break
    _warm.add(key)
