"""Improved routes against closed forms, and what must hold for every route."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq
from skimage.graph import MCP_Geometric

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.motion.steering import Steering
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.improve.bezier import corner_curve
from ambinav_planners.improve.kernel import beside, cheapest_chain, headings, stations
from ambinav_planners.improve.route import improve
from tests.geometry.scenes import environment, points_inside, room, scene

Floats = NDArray[np.float64]
Level = Callable[[Floats, Floats], Any]
R2 = Steering("r2")
LONG = Footprint.polygon([(-0.3, -0.15), (0.3, -0.15), (0.3, 0.15), (-0.3, 0.15)])


def service_of(
    env: Environment, level: Level, weight: float = 1.0, spacing: float = 0.1, turns: int = 0
) -> AmbiguityService:
    """A service over a made-up map; with `turns` headings the level is halved towards +x."""
    lattice = Lattice.over(env, spacing)
    x, y = np.meshgrid(lattice.x, lattice.y)
    values = np.broadcast_to(np.asarray(level(x, y), dtype=np.float32), x.shape)
    out = xr.Dataset(coords={"y": lattice.y, "x": lattice.x})
    for name in schema.REQUIRED_LAYERS:
        out[name] = (("y", "x"), values)
    out["free"] = (("y", "x"), lattice.free)
    if turns:
        out.coords["theta"] = np.arange(turns) * 2 * math.pi / turns
        factor = (0.75 - 0.25 * np.cos(out.coords["theta"].values)).astype(np.float32)
        out["level"] = (("y", "x", "theta"), values[:, :, None] * factor)
        out["level_mean"] = (("y", "x"), values * factor.mean())
    out["zone"] = (("y", "x"), np.zeros(x.shape, dtype=np.uint8))
    out["segments"] = (("segment", "end"), env.segments.xy)
    out["segment_kind"] = (("segment",), np.asarray(env.segments.kind, dtype=np.uint8))
    outline = np.frombuffer(shapely.to_wkb(env.free), dtype=np.uint8).copy()
    out["floor"] = (("byte",), outline)
    out.attrs = {
        "environment": env.name,
        "scanner": "made-up scanner",
        "parameters": json.dumps({"spacing": spacing}),
    }
    return AmbiguityService(AmbiguityMap(out), weight=weight)


def line(*points: tuple[float, float]) -> Floats:
    return R2.oriented(np.column_stack([np.array(points, dtype=float), np.zeros(len(points))]))


def jagged(a: tuple[float, float], b: tuple[float, float], count: int, amplitude: float) -> Floats:
    """A rough path from a to b, always the same."""
    rng = np.random.default_rng(count)
    path = np.linspace(a, b, count)
    path[1:-1] += rng.normal(0.0, amplitude, (count - 2, 2))
    return line(*(tuple(point) for point in path))


def stairs(a: tuple[float, float], b: tuple[float, float]) -> Floats:
    """A path as a lattice of eight directions has it: diagonal first, then along an axis."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    d = min(abs(dx), abs(dy))
    return line(a, (a[0] + math.copysign(d, dx), a[1] + math.copysign(d, dy)), b)


def layered(y: Floats, n: Floats, x: float) -> float:
    """Cheapest path through layers: from (0, y[0]) to (x, y[-1]), the density n linear between y.

    Snell: density times the cosine to the layers is the same all along.
    """
    fine = np.linspace(y[0], y[-1], 200_001)
    middle = np.interp((fine[1:] + fine[:-1]) / 2, y, n)
    step = np.diff(fine)
    c = brentq(
        lambda c: (c / np.sqrt(middle**2 - c * c) * step).sum() - x, 1e-9, middle.min() * (1 - 1e-9)
    )
    return float((middle**2 / np.sqrt(middle**2 - c * c) * step).sum())


WAYS = {
    "straight": lambda a, b: line(a, b),
    "stairs": stairs,
    "jagged": lambda a, b: jagged(a, b, 25, 0.5),
    "trembling": lambda a, b: jagged(a, b, 150, 0.05),
}


@pytest.mark.parametrize("path", WAYS)
@pytest.mark.parametrize(("low", "high", "x"), [(0, 2, 8), (0, 5, 10), (1, 2, 3)])
def test_a_border_is_crossed_by_snells_law(path: str, low: float, high: float, x: float) -> None:
    env = room(20.0, 14.0)
    service = service_of(env, lambda _, y: np.where(y < 7.0, low, high))
    a, b = (4.0, 3.0), (4.0 + x, 11.0)
    y = np.array([3.0, 6.95, 7.05, 11.0])
    exact = layered(y, 1.0 + np.array([low, low, high, high]), x)
    route = improve(WAYS[path](a, b), service, CollisionChecker(env, Footprint.disc(0.2), R2))
    cost = service.route_cost(route, R2)
    assert exact * (1 - 1e-5) <= cost <= exact * 1.001


@pytest.mark.parametrize("path", WAYS)
@pytest.mark.parametrize(("slope", "x"), [(0.4, 10.0), (0.5, 12.0), (0.3, 20.0)])
def test_on_a_slope_the_way_is_a_catenary(path: str, slope: float, x: float) -> None:
    # Density n = 6 + slope * y from (0, 0) to (x, 0): n = c cosh(slope * (s - x / 2) / c) at s.
    env = room(26.0, 20.0)
    service = service_of(env, lambda _, y: 5.0 + slope * (y - 10.0))
    c = brentq(lambda c: c * math.cosh(slope * x / 2 / c) - 6.0, 3.5, 6.0)
    exact = c * (x / 2 + c / (2 * slope) * math.sinh(slope * x / c))
    a, b = (3.0, 10.0), (3.0 + x, 10.0)
    route = improve(WAYS[path](a, b), service, CollisionChecker(env, Footprint.disc(0.2), R2))
    cost = service.route_cost(route, R2)
    assert exact * (1 - 1e-5) <= cost <= exact * 1.001


@pytest.mark.parametrize("path", WAYS)
def test_around_a_hill(path: str) -> None:
    # Bouguer: in a density that depends on the distance r from the top alone, n r times the sine
    # of the angle to the radius is the same all along; it is n r at the nearest point.
    radius, sweep = 5.0, math.radians(160.0)

    def density(r: float) -> float:
        return 1.0 + math.exp(-r * r / 8.0)

    def along(nearest: float, integrand: Callable[[float, float], float]) -> float:
        c = density(nearest) * nearest

        def part(s: float) -> float:  # r = nearest + s^2: no singularity at the nearest point
            r = nearest + s * s
            return integrand(r, c) / math.sqrt((density(r) * r) ** 2 - c * c) * 2.0 * s

        return 2.0 * quad(part, 1e-9, math.sqrt(radius - nearest), limit=200)[0]

    nearest = brentq(lambda r: along(r, lambda s, c: c / s) - sweep, 2.5, 4.5)
    exact = along(nearest, lambda r, _: density(r) ** 2 * r)
    env = room(14.0, 14.0)
    service = service_of(
        env, lambda x, y: np.exp(-((x - 7.0) ** 2 + (y - 7.0) ** 2) / 8.0), spacing=0.05
    )
    a = (7.0 + radius * math.cos(sweep / 2), 7.0 + radius * math.sin(sweep / 2))
    b = (a[0], 14.0 - a[1])
    route = improve(WAYS[path](a, b), service, CollisionChecker(env, Footprint.disc(0.2), R2))
    cost = service.route_cost(route, R2)
    assert exact * (1 - 5e-4) <= cost <= exact * 1.001
    # A fine lattice of eight directions is an upper bound that knows nothing of all this.
    fine = np.arange(0.0, 14.01, 0.05)
    grid = service.cost(*np.meshgrid(fine[1:-1], fine[1:-1]))
    search = MCP_Geometric(grid, sampling=(0.05, 0.05))
    ends = [tuple(int(round(v / 0.05)) - 1 for v in (p[1], p[0])) for p in (a, b)]
    costs, _ = search.find_costs([ends[0]], [ends[1]])
    assert cost <= costs[ends[1]] + 0.1


@pytest.mark.parametrize("radius", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("smooth", [False, True])
def test_around_a_corner_the_way_is_tangent_arc_tangent(radius: float, smooth: bool) -> None:
    free = shapely.box(0, 0, 12, 12) - shapely.box(5, 0, 9, 6)
    env = environment(free)
    service = service_of(env, lambda x, _: 0.0 * x)
    a, b, corner = np.array([4.0, 3.0]), np.array([8.0, 7.0]), np.array([5.0, 6.0])
    to_a, to_b = math.dist(a, corner), math.dist(b, corner)
    inside = math.acos(float((a - corner) @ (b - corner)) / (to_a * to_b))
    arc = 2 * math.pi - inside - math.acos(radius / to_a) - math.acos(radius / to_b)
    exact = math.sqrt(to_a**2 - radius**2) + math.sqrt(to_b**2 - radius**2) + radius * arc
    rough = line((4.0, 3.0), (2.0, 5.0), (3.5, 8.0), (4.5, 7.0), (6.0, 9.0), (8.0, 7.0))
    checker = CollisionChecker(env, Footprint.disc(radius), R2)
    route = improve(rough, service, checker, smooth=smooth)
    cost = service.route_cost(route, R2)
    assert exact * (1 - 1e-6) <= cost <= exact * 1.001


def test_without_a_cost_the_way_is_straight() -> None:
    env = room(64.0, 12.0)
    service = service_of(env, lambda x, _: 0.0 * x)
    rough = jagged((2.0, 6.0), (62.0, 6.0), 300, 0.3)
    route = improve(rough, service, CollisionChecker(env, Footprint.disc(0.25), R2))
    assert service.route_cost(route, R2) == pytest.approx(60.0, rel=1e-6)


def test_smoothing_takes_corners_away() -> None:
    env = scene(3, size=20.0, blocks=8, thin=3)
    service, checker, route = case(env, R2, Footprint.disc(0.2), 0)
    turn = [
        np.abs(
            np.angle(np.exp(1j * np.diff(improve(route, service, checker, smooth=smooth)[:-1, 2])))
        ).max()
        for smooth in (False, True)
    ]
    assert turn[1] < turn[0]


def case(
    env: Environment, steering: Steering, footprint: Footprint, seed: int, turns: int = 0
) -> tuple[AmbiguityService, CollisionChecker, Floats]:
    """A service with hills and dales, a checker, and a rough free route in a scene."""
    rng = np.random.default_rng(seed)
    waves = rng.uniform(0.2, 1.5, (2, 2))
    service = service_of(
        env,
        lambda x, y: 0.5 + 0.5 * np.sin(waves[0, 0] * x + 2) * np.sin(waves[1, 1] * y),
        5.0,
        0.2,
        turns,
    )
    checker = CollisionChecker(env, footprint, steering)
    places = points_inside(env, 400, seed, margin=0.4)
    poses = np.column_stack([places, rng.uniform(-math.pi, math.pi, len(places))])
    poses = poses[checker.poses_free(poses)]
    route = [poses[0]]
    for _ in range(12):
        last = np.broadcast_to(route[-1], poses.shape).copy()
        near = np.hypot(*(poses - last)[:, :2].T) < 6.0
        ahead = np.flatnonzero(checker.motions_free(last, poses) & near)
        route.append(poses[rng.choice(ahead)])
    return service, checker, steering.oriented(np.array(route))


KINDS = [
    (R2, Footprint.disc(0.2)),
    (R2, LONG),
    (Steering("se2"), Footprint.disc(0.2)),
    (Steering("se2"), LONG),
    (Steering("dubins", 0.5), LONG),
    (Steering("reeds-shepp", 0.5), Footprint.disc(0.2)),
]
NAMES = [f"{steering.space}-{'disc' if f.is_disc else 'polygon'}" for steering, f in KINDS]


@pytest.mark.slow(kept=("dubins-polygon", "r2-polygon", "reeds-shepp-disc"))
@pytest.mark.parametrize(("steering", "footprint"), KINDS, ids=NAMES)
@given(seed=st.integers(0, 2**20), turns=st.sampled_from([0, 6]))
@settings(max_examples=8, deadline=None)
def test_never_dearer_always_free_ends_kept(
    steering: Steering, footprint: Footprint, seed: int, turns: int
) -> None:
    env = scene(seed % 7, size=16.0, blocks=6, thin=3)
    service, checker, route = case(env, steering, footprint, seed, turns)
    before = route.copy()
    better = improve(route, service, checker)
    assert (route == before).all()
    assert service.route_cost(better, steering) <= service.route_cost(route, steering)
    assert checker.poses_free(better[:1])[0]
    assert checker.motions_free(better[:-1], better[1:]).all()
    axes = 2 if steering.space == "r2" else 3
    assert (better[[0, -1], :axes] == route[[0, -1], :axes]).all()
    assert (steering.oriented(better) == better).all()
    assert (improve(route, service, checker) == better).all()


def test_shortcuts_alone_find_the_straight_way() -> None:
    env = room(20.0, 14.0)
    service = service_of(env, lambda x, _: 0.0 * x)
    checker = CollisionChecker(env, Footprint.disc(0.2), Steering("se2"))
    route = np.array([[2, 2, 3.0], [5, 9, -2.0], [9, 3, 1.0], [15, 12, 0.5]])
    better = improve(route, service, checker, rounds=0, smooth=False)
    assert (better == route[[0, -1]]).all()


@pytest.mark.parametrize("footprint", [LONG, Footprint.disc(0.2)])
def test_headings_go_along_the_travel(footprint: Footprint) -> None:
    free = shapely.box(0, 0, 12, 12) - shapely.box(5, 0, 9, 6)
    env = environment(free)
    service = service_of(env, lambda x, _: 0.0 * x)
    checker = CollisionChecker(env, footprint, Steering("se2"))
    route = np.array([[4.0, 3.0, 1.5], [3.0, 8.0, 3.0], [8.0, 7.0, 0.0]])
    better = improve(route, service, checker)
    travel = np.arctan2(*np.diff(better[:, :2], axis=0).T[::-1])
    off = np.angle(np.exp(1j * (better[1:-1, 2] - travel[1:])))
    assert np.abs(off).max() < 0.1


def test_a_heading_that_is_cheaper_is_kept() -> None:
    # Looking towards +x costs half: on the way back the robot drives backwards.
    env = room(20.0, 6.0)
    service = service_of(env, lambda x, _: 1.0 + 0.0 * x, 5.0, turns=8)
    checker = CollisionChecker(env, Footprint.disc(0.2), Steering("se2"))
    route = np.array([[18.0, 3.0, math.pi], [10.0, 3.0, math.pi], [2.0, 3.0, math.pi]])
    better = improve(
        np.insert(route, [1, 2], [[14, 3, 1.0], [6, 3, 1.0]], axis=0), service, checker
    )
    middle = better[np.abs(better[:, 0] - 10.0) < 5.0]
    assert np.abs(middle[:, 2]).max() < 0.5


def test_a_long_robot_passes_where_it_cannot_turn() -> None:
    thin = np.array([[5.0, 0.0, 5.0, 2.75], [5.0, 3.25, 5.0, 6.0], [5.4, 0.0, 5.4, 2.75],
                     [5.4, 3.25, 5.4, 6.0]])  # fmt: skip
    env = room(10.0, 6.0, thin)
    service = service_of(env, lambda x, _: 0.0 * x)
    checker = CollisionChecker(env, LONG, R2)
    route = line((1.0, 1.0), (3.0, 5.0), (4.0, 3.0), (6.5, 3.0), (8.0, 1.0), (9.0, 5.0))
    better = improve(route, service, checker)
    assert service.route_cost(better, R2) < 0.75 * service.route_cost(route, R2)
    assert checker.motions_free(better[:-1], better[1:]).all()


@pytest.mark.parametrize("space", ["dubins", "reeds-shepp"])
def test_curves_come_near_to_the_straight_way(space: str) -> None:
    env = room(20.0, 14.0)
    service = service_of(env, lambda x, _: 0.0 * x)
    checker = CollisionChecker(env, Footprint.disc(0.2), Steering(space, 0.5))
    route = np.array([[2, 7, 0.0], [5, 9, -2.0], [8, 5, 1.0], [12, 8, 3.0], [18, 7, 0.0]])
    better = improve(route, service, checker)
    assert service.route_cost(better, checker.steering) == pytest.approx(16.0, rel=2e-3)


def test_bad_routes_are_refused() -> None:
    env = room(10.0, 6.0, np.array([[5.0, 0.0, 5.0, 5.0]]))
    service = service_of(env, lambda x, _: 0.0 * x)
    checker = CollisionChecker(env, Footprint.disc(0.2), R2)
    with pytest.raises(InputError, match=r"poses\[0\] to poses\[1\] is not free"):
        improve(line((1.0, 1.0), (9.0, 1.0)), service, checker)
    with pytest.raises(InputError, match=r"poses\[0\] is not free"):
        improve(line((0.1, 1.0), (2.0, 1.0)), service, checker)
    with pytest.raises(InputError, match="has 1 poses"):
        improve(line((1.0, 1.0)), service, checker)
    with pytest.raises(InputError, match="rounds is -1"):
        improve(line((1.0, 1.0), (2.0, 1.0)), service, checker, rounds=-1)
    with pytest.raises(InputError, match="not finite"):
        improve([[0.0, 0.0, math.nan], [1.0, 1.0, 0.0]], service, checker)


def test_a_route_that_stands_still_stays() -> None:
    env = room(10.0, 6.0)
    service = service_of(env, lambda x, _: 0.0 * x)
    for steering in (R2, Steering("se2")):
        checker = CollisionChecker(env, Footprint.disc(0.2), steering)
        still = np.array([[2.0, 2.0, 0.5], [2.0, 2.0, 0.5]])
        better = improve(still, service, checker)
        assert (better == still).all()


def test_the_chain_is_the_cheapest_of_all() -> None:
    env = scene(1, size=10.0, blocks=4, thin=4)
    service, checker, _ = case(env, R2, Footprint.disc(0.1), 4)
    values, _, *rest = service.density.arrays
    rng = np.random.default_rng(5)
    solved = 0
    for _ in range(20):
        middle = points_inside(env, 12, int(rng.integers(1000)), 0.1).reshape(4, 3, 2)
        candidates = np.zeros((6, 3, 3))
        candidates[1:-1, :, :2] = middle
        candidates[0], candidates[-1] = [*middle[0, 0] + 0.01, 0], [*middle[3, 0] - 0.01, 0]
        best = math.inf
        for stops in itertools.product(range(-1, 3), repeat=4):
            chain = [candidates[0, 0]]
            chain += [candidates[k + 1, b] for k, b in enumerate(stops) if b >= 0]
            chain.append(candidates[-1, 0])
            path = np.array(chain)
            if checker.motions_free(path[:-1], path[1:]).all():
                best = min(best, service.route_cost(path, R2))
        found, cost = cheapest_chain(
            0, 0.0, candidates, np.zeros(6, dtype=np.int64), 1.0, (values, *rest), checker.arrays
        )
        assert cost == pytest.approx(best, abs=1e-6)
        if math.isfinite(best):
            solved += 1
            assert service.route_cost(found, R2) == pytest.approx(best, abs=1e-6)
        else:
            assert len(found) == 0
    assert solved > 5


def test_stations_keep_vertices_and_stand_closer_at_corners() -> None:
    route = line((0.0, 0.0), (10.0, 0.0), (10.0, 7.3), (10.0, 12.0))
    points = stations(route, 1.0)
    step = np.hypot(*np.diff(points[:, :2], axis=0).T)
    assert step.max() <= 1.0 + 1e-9
    for vertex in route:
        assert np.isclose(points[:, :2], vertex[:2]).all(axis=1).any()
    at = int(np.flatnonzero(np.isclose(points[:, :2], route[1, :2]).all(axis=1))[0])
    assert max(step[at - 1], step[at]) <= 0.26
    assert step[-1] > 0.7


def test_candidates_stand_across_the_route() -> None:
    route = line((0.0, 0.0), (1.0, 0.0), (2.0, 1.0), (4.0, 1.0))
    out = beside(route, 10.0, 0.1, 2)
    assert out.shape == (4, 5, 3)
    assert (out[:, 0] == route).all()
    assert (out[[0, -1]] == route[[0, -1], None]).all()
    across = np.array([-math.sin(math.pi / 8), math.cos(math.pi / 8)])
    offsets = (out[1, :, :2] - route[1, :2]) @ across
    assert offsets == pytest.approx([0.0, 0.1, -0.1, 0.2, -0.2])


def test_candidate_headings() -> None:
    route = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [1.0, 1.0, 2.0]])
    out = headings(route, 0.1, 1)
    assert out[1, :, 2] == pytest.approx([math.pi / 4, 2.0, 2.1, 1.9])
    assert (out[[0, 2], :, 2] == 2.0).all()


@given(st.floats(0.02, 2.8), st.floats(0.05, 1.0))
def test_a_corner_curve_is_nearly_an_arc(turn: float, offset: float) -> None:
    a, corner = np.array([-2.0, 0.0, 0.0]), np.zeros(3)
    b = np.array([2 * math.cos(turn), 2 * math.sin(turn), 0.0])
    out = np.empty((21, 3))
    corner_curve(a, corner, b, offset, 20, out)
    assert out[0, :2] == pytest.approx([-offset, 0.0], abs=1e-12)
    assert out[-1, :2] == pytest.approx(b[:2] / 2 * offset, abs=1e-12)
    radius = offset / math.tan(turn / 2)
    away = np.hypot(out[:, 0] + offset, out[:, 1] - radius)
    assert away == pytest.approx(radius, rel=0.01)
