"""The last step of every planner: improve and measure its path, or report the failure."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ambinav.geometry.collision.sweep import motion_free, pose_free
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats
from ambinav_planners.improve.legal import improve_legally
from ambinav_planners.improve.limited import improve_within
from ambinav_planners.improve.route import improve
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Planner, PlannerResult, planners
from ambinav_planners.search.alternatives import joined_routes
from ambinav_planners.search.cheapest import cheapest_on

# A path this long, metres, is improved to load what improves paths.
TRIAL = 0.02

_warm: set[tuple[object, ...]] = set()


def finish(
    chosen: Planner,
    problem: Problem,
    result: PlannerResult,
    seed: int | None,
    *,
    improved: bool = True,
    on_path: Callable[[Floats], None] | None = None,
) -> Route:
    """Improve and measure a planner's result.

    Args:
        chosen: The planner.
        problem: The planning problem.
        result: The planner's result, with poses.
        seed: Seed of the planner.
        improved: Whether to improve at all.
        on_path: See `Budget`; it gets the improved ones too.
    """
    if result.poses is None:
        raise ValueError("nothing was found")
    warm_up(problem)
    started = time.perf_counter()
    poses = result.poses
    if improved and not result.finished:
        if on_path is not None:
            on_path(poses)
        poses = _cheapest_improved([poses, *result.alternatives], problem, on_path)
    seconds = result.seconds + time.perf_counter() - started
    route = evaluate_route(
        problem.service,
        poses,
        problem.steering,
        planner=chosen.name,
        seed=seed,
        seconds=seconds,
        first_seconds=result.curve[0][0] if result.curve else None,
        iterations=result.iterations,
        curve=result.curve,
        covariances=result.covariances,
    )
    if not result.curve or route.cost < result.curve[-1][1]:
        route = replace(route, curve=(*result.curve, (seconds, route.cost)))
    return route


def warm_up(problem: Problem) -> None:
    """Call every kernel that planning this problem calls, once in a process for each kind.

    The first call of a kernel in a process loads it, and after an installation compiles it, which
    takes longer than a planner is commonly given: so it comes before the planner's clock starts.
    """
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
        path = np.stack([start, end])
        if checker.poses_free(path).all() and checker.motions_free(path[:1], path[1:])[0]:
            improve(path, service, checker)
            service.route_exposure(path, steering)
            break
    _warm.add(key)


def is_free(poses: Floats, problem: Problem) -> bool:
    """Return whether every motion of a path is free.

    A motion that is called free is free, but a polygon that turns within a millimetre of a wall may
    be called blocked in one direction and free in the other; where the path back is the same,
    either will do.
    """
    checker = problem.checker
    free = checker.motions_free(poses[:-1], poses[1:])
    if not checker.is_directed:
        free |= checker.motions_free(poses[1:], poses[:-1])
    return bool(checker.poses_free(poses[:1])[0] and free.all())


def _cheapest_improved(
    routes: list[Floats], problem: Problem, on_path: Callable[[Floats], None] | None
) -> Floats:
    """Return the cheapest of the improved routes and of the combination of their best parts."""
    improved = []
    for poses in routes:
        improved.append(_improve(poses, problem))
        if on_path is not None:
            on_path(improved[-1])
    if len(improved) > 1:
        parts = cheapest_on(joined_routes(improved, problem.service, problem.checker), problem)
        if parts is not None and (problem.one_way is None or problem.one_way.allow(parts)):
            improved.append(_improve(parts, problem))
            if on_path is not None:
                on_path(improved[-1])
    return min(improved, key=lambda poses: problem.service.route_cost(poses, problem.steering))


def _improve(poses: Floats, problem: Problem) -> Floats:
    """Return the improved route; it keeps the limit on consecutive bad metres if `poses` does.

    A route that is called free in the other direction only (see `is_free`) is left as it is.
    """
    if not problem.checker.motions_free(poses[:-1], poses[1:]).all():
        return poses
    if problem.one_way is not None:
        return improve_legally(poses, problem, problem.one_way)
    if problem.limit is None:
        return improve(poses, problem.service, problem.checker)
    better = improve_within(poses, problem.service, problem.checker, problem.limit)
    return poses if better is None else better


def not_found(chosen: Planner, problem: Problem, budget: Budget) -> str:
    """Format the error of a planner that found no path although the lattice has one."""
    if problem.one_way is not None:
        return (
            f"planner {chosen.name!r} found no path that goes against no one-way lane; turn a "
            "lane round or leave it out, or see without them whether there is a path at all."
        )
    if problem.limit is not None:
        return (
            f"planner {chosen.name!r} found no path with at most {problem.limit.metres:g} m in a "
            f"row above level {problem.limit.level:g}; allow more or a higher level, or see "
            "without the limit whether there is a path at all."
        )
    belief = problem.belief
    if chosen.name.startswith("belief") and math.isfinite(min(belief.max_std, belief.max_goal_std)):
        limits = [
            f"up to {limit:g} m{where}"
            for limit, where in ((belief.max_std, ""), (belief.max_goal_std, " at the goal"))
            if math.isfinite(limit)
        ]
        if belief.std > belief.max_std:
            return (
                f"start_std is {belief.std:g} m, more than the {belief.max_std:g} m of max_std "
                "(--start-std and --max-std of `ambinav plan`); give a smaller deviation at the "
                "start, or a larger limit."
            )
        return (
            f"planner {chosen.name!r} found no path that keeps the standard deviation "
            f"{' and '.join(limits)}; allow more, or see without a limit whether there is a path "
            "at all."
        )
    if not chosen.iteration or not chosen.uses_ompl:
        return (
            f"planner {chosen.name!r} found no path over the map's lattice of "
            f"{problem.service.map.spacing:g} m and its channels; where this robot only just gets "
            "through, another planner, such as prmstar, may."
        )
    spent = f"{budget.seconds:g} s"
    if budget.iterations is not None:
        spent = f"{budget.iterations} {chosen.iteration}"
    space = problem.steering.space
    alternatives = sorted(
        p.name for p in planners().values() if space in p.spaces and p.name != chosen.name
    )
    resource = "time" if budget.iterations is None else "iterations"
    return (
        f"planner {chosen.name!r} found no path in {space} in {spent}; there may be none for this "
        f"robot, or it takes more {resource} or another planner ({', '.join(alternatives)})."
    )
