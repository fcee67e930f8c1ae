"""Routes in space over a fence, against distances and sums in closed form."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from ompl import base as ob
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

from ambinav import (
    AmbiguityVolume,
    Environment,
    RangeScanner,
    RangeSensor,
    Solid,
    VolumeService,
    build_volume,
    environment_from_shapes,
    extruded,
)
from ambinav.casting.solids import with_solids
from ambinav.runtime.errors import InputError
from ambinav_planners import FlightObjective, FlightPlanner, FlightRoute, certify, load_flight
from ambinav_planners.planning import NotFoundError
from ambinav_planners.search import lower_bound_in_space as bounds_module
from ambinav_planners.search.lower_bound_in_space import lower_bound_in_space

RADIUS = 0.2
START, GOAL = (1.0, 2.0, 0.5), (7.0, 3.1, 0.5)
# Across the room, with a hatch under the ceiling that only a robot in the air gets through.
FENCE = (3.9, 4.1, 1.1)


def room(*solids: Solid) -> Environment:
    plan = environment_from_shapes(rooms=[shapely.box(0.0, 0.0, 8.0, 5.0)], name="room")
    fence = Solid(shapely.box(FENCE[0], 0.0, FENCE[1], 5.0), 0.0, FENCE[2])
    return plan.in_space(with_solids(extruded(plan, 2.4), [fence, *solids]))


@pytest.fixture(scope="module")
def volume() -> AmbiguityVolume:
    laser = RangeSensor(max_range=2.2, std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor=laser, beams=24, aperture=2.0 * math.pi)
    heights = (0.5, 1.0, 1.5, 2.0)
    return build_volume(room(), scanner, heights, 0.25, robot_radius=RADIUS, store=False)


@pytest.fixture(scope="module")
def robot(volume: AmbiguityVolume) -> FlightPlanner:
    return FlightPlanner(VolumeService(volume, weight=4.0), room(), RADIUS)


def clearance(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance from the fence and the room's six sides, in closed form."""
    x, _, z = points.T
    beside = np.maximum(np.maximum(FENCE[0] - x, x - FENCE[1]), 0.0)
    over = np.maximum(z - FENCE[2], 0.0)
    sides = np.concatenate([points, np.array([8.0, 5.0, 2.4]) - points], axis=1).min(axis=1)
    return np.asarray(np.minimum(np.hypot(beside, over), sides))


def along(points: NDArray[np.float64], each: int = 4000) -> tuple[NDArray[np.float64], ...]:
    """Points in the middle of many equal pieces of every motion, and the pieces' lengths."""
    share = ((np.arange(each) + 0.5) / each)[:, None]
    parts = [a + share * (b - a) for a, b in pairwise(points)]
    lengths = [np.full(each, math.dist(a, b) / each) for a, b in pairwise(points)]
    return np.concatenate(parts), np.concatenate(lengths)


@pytest.mark.parametrize(("planner", "iterations"), [("bitstar", 4000), ("informed-rrtstar", 800)])
def test_a_route_over_the_fence(robot: FlightPlanner, planner: str, iterations: int) -> None:
    route = robot.plan(START, GOAL, planner_name=planner, seconds=20.0, iterations=iterations)
    assert route.points[0] == pytest.approx(START)
    assert route.points[-1] == pytest.approx(GOAL)
    points, lengths = along(route.points)
    assert clearance(points).min() >= RADIUS - 1e-6
    assert points[:, 2].max() >= FENCE[2] + RADIUS - 1e-6
    # The cost against a sum over the levels, which shares no code with it.
    service = robot.service
    axes = tuple(service.volume.dataset[name].values for name in ("y", "x", "z"))
    price = RegularGridInterpolator(axes, service.density.astype(float))(points[:, [1, 0, 2]])
    assert route.cost == pytest.approx(float(price @ lengths), rel=1e-4)
    assert route.cost >= route.length == pytest.approx(lengths.sum())
    # Up to the hatch and down again is the least that any route takes.
    top = (4.0, FENCE[2] + RADIUS)
    least = math.dist((START[0], START[2]), top) + math.dist((GOAL[0], GOAL[2]), top)
    assert route.length >= 0.98 * least


def test_ends_beside_the_outermost_cells_are_those_of_the_route() -> None:
    laser = RangeSensor(max_range=2.2, std=0.03, resolution=0.001)
    scanner = RangeScanner.planar(sensor=laser, beams=24, aperture=2.0 * math.pi)
    coarse = build_volume(room(), scanner, (0.5, 1.0, 1.5), 0.5, robot_radius=0.1, store=False)
    robot = FlightPlanner(VolumeService(coarse, weight=4.0), room(), 0.1)
    ends = (0.11, 0.11, 1.0), (2.0, 4.89, 1.0)
    route = robot.plan(*ends, planner_name="bitstar", seconds=20.0, iterations=300)
    np.testing.assert_allclose(route.points[[0, -1]], ends, atol=1e-9)


def test_shortcuts_cost_less_and_are_free(
    robot: FlightPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    zigzag = [(2.0, 3.5, 1.0), (3.2, 1.5, 1.8), (4.0, 2.5, 1.6), (5.0, 4.0, 1.5), (6.0, 2.0, 0.8)]
    found = np.array([START, *zigzag, GOAL])
    curve = ((0.1, robot.service.route_cost(found)),)
    monkeypatch.setattr("ambinav_planners.flight._solve", lambda *arguments: (found, curve))
    plain, shorter = (robot.plan(START, GOAL, improved=improved) for improved in (False, True))
    np.testing.assert_array_equal(plain.points, found)
    np.testing.assert_array_equal(shorter.points[[0, -1]], found[[0, -1]])
    assert shorter.cost < plain.cost
    dense = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(shorter.points)])
    assert clearance(dense).min() >= RADIUS - 1e-6


def test_the_cost_is_at_least_the_length_in_space(robot: FlightPlanner) -> None:
    space = ob.RealVectorStateSpace(3)
    si = ob.SpaceInformation(space)
    objective = FlightObjective(si, robot.service)
    for ends in np.random.default_rng(1).uniform((0.5, 0.5, 0.5), (7.5, 4.5, 2.0), (50, 2, 3)):
        a, b = si.allocState(), si.allocState()
        for state, place in zip((a, b), ends, strict=True):
            for axis in range(3):
                state[axis] = float(place[axis])
        cost, length = objective.motionCost(a, b).value(), math.dist(*ends)
        assert cost == pytest.approx(robot.service.route_cost(ends))
        assert cost >= objective.motionCostHeuristic(a, b).value() >= length * (1.0 - 1e-12)
        assert objective.stateCost(a).value() >= 1.0
    a[0] = math.nan
    assert objective.stateCost(a).value() == objective.motionCost(a, b).value() == math.inf
    assert objective.motionCostHeuristic(a, b).value() == 0.0
    flat = ob.SpaceInformation(ob.RealVectorStateSpace(2))
    with pytest.raises(InputError, match=r"is not x, y, z; give a RealVectorStateSpace\(3\)"):
        FlightObjective(flat, robot.service)


def test_a_closed_hatch(volume: AmbiguityVolume) -> None:
    door = Solid(shapely.box(FENCE[0], 0.0, FENCE[1], 5.0), FENCE[2], 2.4)
    shut = FlightPlanner(volume, room(door), RADIUS)
    with pytest.raises(NotFoundError, match=r"between 0\.5 and 2 m: .* for the radius of 0\.2 m"):
        shut.plan(START, GOAL, planner_name="rrtstar", seconds=0.1)
    # A slit of 0.1 m more than the robot may be a way on the grid, so nothing is proved.
    slit = Solid(shapely.box(FENCE[0], 0.0, FENCE[1], 4.5), FENCE[2], 2.4)
    narrow = FlightPlanner(volume, room(slit), RADIUS)
    with pytest.raises(
        NotFoundError, match=r"\'rrtstar\' found no path in its 1 iter.*; give it m"
    ):
        narrow.plan(START, GOAL, planner_name="rrtstar", seconds=9.0, iterations=1)


@pytest.fixture(scope="module")
def by_length(volume: AmbiguityVolume) -> FlightPlanner:
    return FlightPlanner(VolumeService(volume, weight=0.0), room(), RADIUS)


@pytest.mark.sweep
def test_the_bound_of_the_way_over_the_fence(by_length: FlightPlanner) -> None:
    # Tangents, arcs and the piece between at the robot's radius; slanted, it is unrolled.
    rise = FENCE[2] - START[2]
    straight = 0.0
    for away in (FENCE[0] - START[0], GOAL[0] - FENCE[1]):
        tangent = math.sqrt(away**2 + rise**2 - RADIUS**2)
        turned = math.atan2(away, rise) - math.asin(RADIUS / math.hypot(away, rise))
        straight += tangent + RADIUS * (math.pi / 2.0 - turned)
    shortest = math.hypot(straight + FENCE[1] - FENCE[0], GOAL[1] - START[1])
    route = by_length.plan(
        START, GOAL, planner_name="informed-rrtstar", iterations=3000, seconds=60.0
    )
    proof = certify(by_length, route, cells=30_000)
    assert proof.bound < shortest <= route.cost < 1.005 * shortest
    assert proof.bound > 0.96 * shortest
    known = 1.5 * shortest
    bound, _ = lower_bound_in_space(
        by_length.service, by_length.checker, START, GOAL, known, 0.01, 3_000
    )
    assert 0.0 < bound < shortest


@pytest.mark.sweep
def test_what_proves_the_bound_is_nowhere_steeper_than_the_cost(
    robot: FlightPlanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute, seen = bounds_module._bounds, []

    def kept(grid, *arguments):
        seen.append((grid, compute(grid, *arguments)))
        return seen[-1][1]

    monkeypatch.setattr(bounds_module, "_bounds", kept)
    certify(robot, flight(robot, [(2.5, 2.0, 1.5), (3.5, 2.2, 1.6)]), gap=1e-3, cells=10_000)
    rng, step = np.random.default_rng(0), 1e-5
    assert len({grid.edges for grid, _ in seen}) >= 2
    for grid, values in seen:
        cells = np.argwhere(grid.open_cells)
        drawn = cells[rng.integers(len(cells), size=200)] + rng.uniform(0.01, 0.99, (200, 3))
        places = np.array(grid.origin) + np.array(grid.edges) * drawn
        price = [robot.service.near(x, y, z) for y, x, z in places.tolist()]
        for bound in values:
            rises = [
                [grid.at(bound, (*place,)) for place in (places + sign * step * axis).tolist()]
                for axis in np.eye(3)
                for sign in (1.0, -1.0)
            ]
            ahead, behind = np.array(rises).reshape(3, 2, -1).transpose(1, 0, 2)
            slope = np.linalg.norm(ahead - behind, axis=0) / (2.0 * step)
            assert (slope <= np.array(price) + 1e-5).all()
            assert slope.max() > 0.9


@pytest.mark.slow
def test_no_motion_costs_less_than_the_bound(robot: FlightPlanner) -> None:
    rng = np.random.default_rng(3)
    ends = rng.uniform((0.3, 0.3, 0.5), (7.7, 4.7, 2.0), (200, 2, 3))
    ends = ends[robot.checker.motions_free(ends[:, 0], ends[:, 1])]
    for start, goal in ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 2.0][:1].tolist():
        cost = robot.service.route_cost([start, goal])
        # A bound that is not held down by what is known.
        bound, _ = lower_bound_in_space(
            robot.service, robot.checker, start, goal, 1.5 * cost, 0.01, 1_000
        )
        assert 0.3 * cost < bound <= cost


@pytest.mark.slow(kept=("0.5",))
@pytest.mark.parametrize("half", [None, 0.06, 0.5])
def test_a_proof_on_few_cells_proves_less_and_nothing_wrong(
    robot: FlightPlanner, half: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a sphere, a flat and a tall cylinder; below the hatch only flat ones get through."""
    ends = (3.0, 2.0, 1.6), (5.0, 2.0, 1.6)
    body = FlightPlanner(robot.service, room(), 0.15, half)
    cost = body.service.route_cost(ends)
    for most in (1, bounds_module.MOST_BOXES):
        monkeypatch.setattr(bounds_module, "MOST_BOXES", most)
        bound, cell = lower_bound_in_space(body.service, body.checker, *ends, 1.5 * cost, 0.01, 500)
        assert 0.2 * cost < bound <= cost
        assert cell <= 0.5
        assert not bounds_module.are_apart(body.service, body.checker, *ends)
    door = Solid(shapely.box(FENCE[0], 0.0, FENCE[1], 5.0), FENCE[2], 2.4)
    shut = FlightPlanner(robot.service, room(door), 0.15, half).checker
    assert bounds_module.are_apart(robot.service, shut, *ends)


def test_short_flights_are_certified_by_the_line(robot: FlightPlanner) -> None:
    """On grids that takes as long as for any other flight: 40 s for a hundredth of a millimetre."""
    for metres in (1e-5, 1e-3, 0.01):
        proof = certify(robot, flight(robot, [START, (START[0] + metres, START[1], START[2])]))
        assert metres < proof.bound < proof.cost
        assert proof.gap < 0.005 and proof.cell == 0.0
    # Of a detour of less than a millimetre no more is proved than that.
    there = START[0] + 1e-4, START[1], START[2]
    proof = certify(robot, flight(robot, [START, there, START, there]))
    assert proof.cell == 0.0 < proof.gap == pytest.approx(2.0 / 3.0, rel=1e-3)


def test_the_bound_of_the_line_is_below_all_costs(robot: FlightPlanner) -> None:
    rng = np.random.default_rng(5)
    ends = rng.uniform((0.3, 0.3, 0.5), (7.7, 4.7, 2.0), (100, 2, 3))
    ends[:50, 1] = ends[:50, 0] + 0.05 * (ends[:50, 1] - ends[:50, 0])
    for start, goal in ends.tolist():
        cost = robot.service.route_cost([start, goal])
        first, last = ((y, x, z) for x, y, z in (goal, start))
        for more in (1.0, 1.2, 3.0):
            bound = bounds_module._bound_of_line(robot.service, first, last, more * cost)
            assert 0.99 * math.dist(start, goal) < bound <= cost


def test_what_cannot_be_certified(robot: FlightPlanner, by_length: FlightPlanner) -> None:
    through = flight(robot, [START, GOAL])
    with pytest.raises(InputError, match="cannot fly the route: it touches a surface"):
        certify(robot, through)
    with pytest.raises(InputError, match="cells is 0; give a number above 0"):
        certify(robot, through, cells=0)
    # At the weight of the route, not of the robot.
    near = flight(robot, [START, (2.0, 2.0, 0.5)])
    assert certify(by_length, near, cells=1).cost == pytest.approx(near.cost)
    assert certify(robot, flight(robot, [START, START])).gap == 0.0
    # Less apart than any cell is wide.
    beside = START[0] + 2e-16, START[1], START[2]
    assert certify(robot, flight(robot, [beside, START])).bound >= 0.0
    with pytest.raises(InputError, match=r"robot is None; give the FlightPlanner of the route"):
        certify(None, near)  # type: ignore[call-overload]


def flight(robot: FlightPlanner, points: list[tuple[float, float, float]]) -> FlightRoute:
    """Return a flight along given points."""
    rows = np.array(points)
    length = float(np.linalg.norm(np.diff(rows, axis=0), axis=1).sum())
    cost = robot.service.route_cost(rows)
    return FlightRoute(rows, cost, length, (), robot.service, RADIUS, None, "given", None)


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ((1.0, 2.0), r"start is \(1\.0, 2\.0\); give x, y and z in metres"),
        ((1.0, 2.0, 2.3), r"start \(1, 2, 2\.3\): z is 2\.3 m and the volume .* from 0\.5 to 2 m"),
        (
            (3.8, 2.0, 0.5),
            r"start .* is nearer to a surface than the radius of 0\.2 m, or in a wall; the",
        ),
        ((20.0, 2.0, 0.5), r"start .* is in a wall, or outside of what the robot"),
    ],
)
def test_starts_of_no_use(robot: FlightPlanner, start: tuple[float, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        robot.plan(start, GOAL)


def test_planners_and_buildings_of_no_use(robot: FlightPlanner) -> None:
    with pytest.raises(InputError, match="'reference', which does not plan in space; give one of"):
        robot.plan(START, GOAL, planner_name="reference")
    with pytest.raises(InputError, match="it is a plan; give the building in space"):
        FlightPlanner(robot.service, room().plan)
    bare = AmbiguityVolume(robot.service.volume.dataset.drop_vars("surfaces"))
    with pytest.raises(InputError, match="surfaces of the building are not kept in this volume"):
        FlightPlanner(bare)


def test_a_volume_keeps_its_building(robot: FlightPlanner) -> None:
    kept = FlightPlanner(robot.service)
    assert kept.checker.radius == RADIUS
    a, b = np.random.default_rng(3).uniform((0.1, 0.1, 0.1), (7.9, 4.9, 2.3), (2, 400, 3))
    free = kept.checker.motions_free(a, b)
    np.testing.assert_array_equal(free, robot.checker.motions_free(a, b))
    inside = np.minimum(np.minimum(a, b), np.array([8.0, 5.0, 2.4]) - np.maximum(a, b)).min(axis=1)
    assert not free[inside < RADIUS].any()
    assert 20 < free.sum() < 380


@pytest.mark.slow
def test_a_picture(robot: FlightPlanner, tmp_path: Path) -> None:
    route = robot.plan(START, GOAL, seconds=20.0, iterations=4000)
    route.draw(tmp_path / "flight.png")
    with Image.open(tmp_path / "flight.png") as picture:
        assert picture.width > 800
        assert picture.height > 500
    with pytest.raises(InputError, match=r"layer is 'zone'; give one of ambiguity, "):
        route.draw(tmp_path / "no.png", "zone")


@pytest.mark.parametrize("suffix", [".csv", ".json"])
def test_files_of_flights_are_read_again(
    robot: FlightPlanner, volume: AmbiguityVolume, tmp_path: Path, suffix: str
) -> None:
    service = VolumeService(volume, weight=4.0)
    points = np.array([START, (3.0, 2.5, 1.7), (5.0, 2.6, 1.6), GOAL])
    route = FlightRoute(
        points, service.route_cost(points), 9.0, ((0.1, 20.0), (0.2, 12.0)), service, RADIUS, 0.1,
        "rrtstar", 3,
    )  # fmt: skip
    path = tmp_path / f"flight{suffix}"
    route.save(path)
    again = load_flight(path, service)
    assert np.array_equal(again.points, points)
    assert again.length == pytest.approx(sum(math.dist(*pair) for pair in pairwise(points)))
    for name in ("cost", "curve", "radius", "half_height", "planner", "seed"):
        assert getattr(again, name) == getattr(route, name), name
    # By another weight it costs something else, and what the planner found is not of it.
    plain = load_flight(path, VolumeService(volume, weight=0.0))
    assert (plain.cost, plain.curve) == (pytest.approx(again.length), ())


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("f.geojson", "{}", r"are read from \.csv or \.json"),
        ("f.json", "[", r"f\.json: not valid JSON"),
        ("f.json", '{"ambinav": {"poses": []}}', r"ambinav\.points is missing"),
        ("f.csv", "# planner: 1\nx,y,z\n1,2,3\n", "line 2: the columns are x, y, z; "),
        ("f.csv", "x,y,z,distance,cost,level\n1,2,3\n", "line 2: it has 3 values"),
        ("f.csv", "x,y,z,distance,cost,level\n1,2,up,0,0,0\n", "line 2: z"),
        ("f.csv", "x,y,z,distance,cost,level\n1,2,1,0,0,0\n", "it has 1 points; "),
        ("f.csv", "x,y,z,distance,cost,level\n1,2,1,0,0,0\n1,2,1,0,0,0\n", "format"),
    ],
)
def test_what_is_no_file_of_a_flight(
    volume: AmbiguityVolume, tmp_path: Path, name: str, text: str, message: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=message):
        load_flight(tmp_path / name, VolumeService(volume))


def test_a_route_outside_of_the_volume_has_no_cost(robot: FlightPlanner) -> None:
    with pytest.raises(InputError, match=r"\(500, 2\) lies outside of .*give points within it"):
        robot.service.route_cost([START, (500.0, 2.0, 1.0)])


@pytest.mark.parametrize("name", ["informed-rrtstar", "sorrtstar", "bitstar"])
def test_a_start_that_is_the_goal(robot: FlightPlanner, name: str) -> None:
    route = robot.plan(START, START, planner_name=name, seconds=0.5)
    assert (route.length, route.cost) == (0.0, 0.0)


def test_something_limits_a_planner(robot: FlightPlanner) -> None:
    with pytest.raises(InputError, match="neither time nor iterations"):
        robot.plan(START, GOAL, seconds=math.inf)
