"""Measurement of a route: length, cost, exposure, metres by zone, longest bad stretches."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_array, check_kind
from ambinav.geometry.frames import wrap_angles
from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import CORRIDOR, NOT_FREE, OPEN, ZONES
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Bytes, Floats, Indices
from ambinav.runtime.errors import InputError
from ambinav.service.field import Field
from ambinav.service.service import AmbiguityService

PER_CELL = 4
"""Samples of the zone in the length of one cell."""
JOINT = 1e-6
"""Largest distances between the ends of joined routes, metres and radians."""


def evaluate_route(
    service: AmbiguityService,
    poses: ArrayLike,
    steering: Steering,
    *,
    planner: str,
    seed: int | None = None,
    seconds: float = 0.0,
    first_seconds: float | None = None,
    iterations: int | None = None,
    curve: Iterable[tuple[float, float]] = (),
    covariances: ArrayLike | None = None,
) -> Route:
    """Measure a route on a map, with the same integrals that planners and service use.

    Its stamps are those of the default `SpeedLimits`; `Route.timed` gives it others.

    Walls are ignored: use a collision check to decide whether the route is possible.

    Args:
        service: The map with its cost per metre.
        poses: x, y, theta, shape (N, 3), N at least 2; metres, radians, map frame. In r2 the
            headings are replaced by the direction of travel, and shape (N, 2) will do.
        steering: The kind of motion.
        planner: Name of the planner.
        seed: Seed of the planner's random numbers.
        seconds: Time that the planner took.
        first_seconds: Time until the first route.
        iterations: Iterations of the planner.
        curve: (seconds, cost) of each improvement.
        covariances: Covariances of x, y, heading at each pose, shape (N, 3, 3), symmetric.

    Raises:
        InputError: fewer than two poses, poses or covariances of another shape, something in
            them is not finite, or a pose lies outside of the map.
    """
    check_kind(service, AmbiguityService, "service")
    check_kind(steering, Steering, "steering")
    route = steering.oriented(poses)
    if len(route) < 2:
        raise InputError(f"poses has {len(route)} of them; a route needs a start and a goal.")
    levels = _levels(service, route)
    dense, _, along = steering.dense(route, service.map.spacing / PER_CELL)
    metres = np.diff(along)
    turned = wrap_angles(np.diff(dense[:, 2]))
    middle = 0.5 * (dense[:-1] + dense[1:])
    middle[:, 2] = dense[:-1, 2] + 0.5 * turned
    codes = zone_codes(service.map, middle)
    is_free = codes != NOT_FREE
    per_zone = np.bincount(codes[is_free], weights=metres[is_free], minlength=len(ZONES))
    moving = metres > 0.0
    codes, metres = codes[moving], metres[moving]
    corridor, wide = codes == CORRIDOR, codes == OPEN
    a, b = route[:-1], route[1:]
    xa, ya, ta = a.T
    xb, yb, tb = b.T
    costs = service.density.integral(xa, ya, ta, xb, yb, tb, steering)
    return Route(
        poses=route,
        steering=steering,
        planner=planner,
        seed=seed,
        environment=str(service.map.dataset.attrs["environment"]),
        scanner=str(service.map.dataset.attrs["scanner"]),
        layer=service.layer,
        weight=service.weight,
        power=service.power,
        clearance_weight=service.clearance_weight,
        comfort=service.comfort,
        length=float(steering.lengths(a, b).sum()),
        cost=service.route_cost(route, steering),
        exposure=service.route_exposure(route, steering),
        zone_metres=dict(zip(ZONES, per_zone.tolist(), strict=True)),
        unexplored_metres=float(metres[codes == NOT_FREE].sum()),
        longest_bad=_longest_run(corridor | wide, metres),
        longest_corridor=_longest_run(corridor, metres),
        longest_open=_longest_run(wide, metres),
        turn=float(np.abs(turned).sum()),
        distance=_up_to(steering.lengths(a, b)),
        spent=_up_to(costs),
        levels=levels,
        zones=zone_codes(service.map, route),
        seconds=float(seconds),
        first_seconds=None if first_seconds is None else float(first_seconds),
        iterations=iterations,
        curve=tuple((float(when), float(cost)) for when, cost in curve),
        covariances=None if covariances is None else _covariances(covariances, len(route)),
    ).timed()


def join_routes(service: AmbiguityService, routes: Sequence[Route]) -> Route:
    """Return the route along several, one after the other, measured anew.

    Predicted covariances are left out: they start anew with each route. The robot stops where one
    ends, and keeps to the `speed_limits` of the first; a bound of the speed, such as that of a
    `BrakingRule`, has to be given anew (`Route.timed`).

    Args:
        service: The map with its cost per metre.
        routes: At least one; each begins where the one before it ends, and, where the motion has
            headings (all spaces but r2), faces the same way.

    Raises:
        InputError: there is none, one begins elsewhere, or their kinds of motion differ.
    """
    if not routes:
        raise InputError("routes is empty; give at least one.")
    steering = routes[0].steering
    for k, (before, after) in enumerate(itertools.pairwise(routes), start=1):
        if after.steering != steering:
            raise InputError(f"routes[{k}] has another kind of motion; give routes of one kind.")
        apart = before.poses[-1] - after.poses[0]
        apart[2] = 0.0 if steering.space == "r2" else wrap_angles(apart[2])
        if np.abs(apart).max() > JOINT:
            begins, ends = (
                "({:g}, {:g}, {:g})".format(*pose) for pose in (after.start, before.goal)
            )
            raise InputError(
                f"routes[{k}] begins at {begins}, and the one before it ends at {ends} (metres, "
                "radians); give routes that follow each other."
            )
    poses = [routes[0].poses, *(route.poses[1:] for route in routes[1:])]
    firsts = [route.first_seconds for route in routes]
    rounds = [route.iterations for route in routes]
    joined = evaluate_route(
        service,
        np.concatenate(poses),
        steering,
        planner=routes[0].planner,
        seed=routes[0].seed,
        seconds=sum(route.seconds for route in routes),
        first_seconds=None if None in firsts else sum(filter(None, firsts)),
        iterations=None if None in rounds else sum(filter(None, rounds)),
    )
    return joined.timed(routes[0].speed_limits, stops=joints(routes))


def joints(routes: Sequence[Route]) -> list[int]:
    """Return the indices of the poses of `join_routes` at which one route ends and one begins."""
    return list(itertools.accumulate(len(route.poses) - 1 for route in routes[:-1]))


def zone_codes(amap: AmbiguityMap, poses: Floats) -> Bytes:
    """Return the zone's code at poses (N, 3), from the nearest possible one, uint8, (N,).

    `NOT_FREE` on floor of which the map says nothing (`AmbiguityMap.unmapped`). Other floor that
    is not judged counts: a robot that drives there reaches it.
    """
    x, y, theta = poses.T
    codes = np.array(amap.sample("zone", x, y, theta))
    lost = np.flatnonzero(~(codes < len(ZONES)))
    if lost.size:
        # The cell is part of a wall, or the heading is not possible there.
        zone = Field.of(amap, "zone")
        row, column = _cells(amap, x[lost], y[lost])
        count = zone.values.shape[2]
        heading = np.rint(np.mod(theta[lost], 2.0 * np.pi) * count / (2.0 * np.pi)).astype(int)
        codes[lost] = zone.values[row, column, heading % count]
    codes[amap.unmapped[_cells(amap, x, y)]] = NOT_FREE
    return codes.astype(np.uint8)


def _cells(amap: AmbiguityMap, x: Floats, y: Floats) -> tuple[Indices, Indices]:
    """Return row and column of the nearest cells, shape (N,) each."""
    row, column = (
        np.clip(np.rint((value - axis[0]) / amap.spacing), 0, axis.size - 1).astype(np.intp)
        for value, axis in ((y, amap.dataset["y"].values), (x, amap.dataset["x"].values))
    )
    return row, column


def _levels(service: AmbiguityService, poses: Floats) -> Floats:
    """Return the layer at poses, extended into cells of walls as in the integrals."""
    field = service.ambiguity
    everywhere = replace(field, free=np.ones_like(field.free), possible=None)
    levels = everywhere.at(*np.ascontiguousarray(poses.T))
    outside = np.flatnonzero(np.isnan(levels))
    if outside.size:
        x, y, _ = poses[outside[0]]
        raise InputError(
            f"poses[{outside[0]}] is at ({x:.10g}, {y:.10g}) m, outside of the map; "
            "give a route in the map's frame."
        )
    return levels


def _longest_run(chosen: Bools, metres: Floats) -> float:
    """Return the length of the longest run of chosen pieces, metres."""
    if not chosen.any():
        return 0.0
    edges = np.flatnonzero(np.diff(chosen.astype(np.int8), prepend=0, append=0))
    metres_before = _up_to(metres)
    return float((metres_before[edges[1::2]] - metres_before[edges[::2]]).max())


def _up_to(parts: Floats) -> Floats:
    """Return running sums, from 0 on."""
    return np.concatenate([[0.0], np.cumsum(parts)])


def _covariances(covariances: ArrayLike, count: int) -> Floats:
    out = as_array(covariances, "covariances", "one of (3, 3) for each pose")
    if out.shape != (count, 3, 3):
        raise InputError(
            f"covariances has the shape {out.shape}; give one of (3, 3) for each of the "
            f"{count} poses."
        )
    if not np.isfinite(out).all():
        raise InputError("covariances must be finite, in metres and radians squared.")
    if not np.allclose(out, out.transpose(0, 2, 1), rtol=1e-6, atol=1e-12):
        raise InputError("covariances holds one that is not symmetric; give symmetric matrices.")
    return 0.5 * (out + out.transpose(0, 2, 1))
