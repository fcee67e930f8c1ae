"""Where a robot can stand, and that a pose where it cannot is no neighbour: shapely knows."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.ambiguity import reference
from ambinav.ambiguity.feasible_poses import can_stand, standing_lattice
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.reach import reach
from ambinav.ambiguity.tensor import relative_radii
from ambinav.buildings.boundary import environment_from_grid
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import STEPS, Lattice
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, OccupancyGrid
from ambinav.map_building.build import build_map
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

TURN = 2 * math.pi
LASER = RangeSensor(max_range=3.0, std=0.02, resolution=0.001)
SPACING, RADIUS = 0.25, 0.5

offsets = st.tuples(st.floats(0.0, 0.3), st.floats(0.0, TURN)).map(
    lambda polar: (polar[0] * math.cos(polar[1]), polar[0] * math.sin(polar[1]))
)


@st.composite
def mounts(draw: st.DrawFn) -> RangeScanner:
    """A fan, two fans or a ring anywhere on the robot."""
    kind = draw(st.sampled_from(["fan", "pair", "ring"]))
    if kind == "ring":
        ring = RangeScanner.ring(LASER, 9, draw(st.floats(0.05, 0.3)), draw(st.floats(0.0, 1.0)))
        dx, dy = draw(offsets)
        return RangeScanner.from_mounts(LASER, ring.mounts + np.array([dx, dy, 0.0]))
    fans = [
        RangeScanner.planar(LASER, 9, 4.0, (*draw(offsets), draw(st.floats(0.0, TURN))))
        for _ in range(1 if kind == "fan" else 2)
    ]
    return RangeScanner.mixed(*fans)


def shapely_stands(
    env: Environment, scanner: RangeScanner, x: float, y: float, theta: float, radius: float
) -> tuple[bool, bool]:
    """Whether a robot can stand there, and whether that is too close a call to be compared."""
    walls = shapely.multilinestrings(list(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2))))
    good, margin = env.free.contains(shapely.Point(x, y)), math.inf
    room = shapely.distance(walls, shapely.Point(x, y))
    good, margin = good and room >= radius, min(margin, abs(room - radius))
    c, s = math.cos(theta), math.sin(theta)
    for mx, my in np.unique(scanner.mounts[:, :2], axis=0):
        sensor = shapely.Point(x + c * mx - s * my, y + s * mx + c * my)
        arm = shapely.LineString([(x, y), sensor])
        good = good and env.free.contains(sensor) and not walls.intersects(arm)
        margin = min(margin, shapely.distance(walls, sensor), *_tips(env, arm))
    return bool(good), bool(margin < 1e-5)


def _tips(env: Environment, arm: shapely.LineString) -> NDArray[np.float64]:
    return np.asarray(shapely.distance(shapely.points(env.segments.xy.reshape(-1, 2)), arm))


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(
    scanner=mounts(),
    seed=st.integers(0, 200),
    theta=st.floats(0.0, TURN),
    radius=st.sampled_from([0.0, 0.0, 0.15, 0.3]),
)
def test_can_stand_is_what_shapely_says(
    scanner: RangeScanner, seed: int, theta: float, radius: float
) -> None:
    env = scenes.scene(seed, size=4.0, blocks=6, thin=3)
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-0.2, 4.2, (2, 40))
    found = can_stand(env, scanner, x, y, theta, radius)
    for k in range(40):
        expected, close = shapely_stands(env, scanner, x[k], y[k], theta, radius)
        assert close or found[k] == expected


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(
    scanner=mounts(), seed=st.integers(0, 200), heading=st.integers(0, 2),
    radius=st.sampled_from([0.0, 0.1, 0.2]),
)  # fmt: skip
def test_neighbours_are_those_that_possible_steps_lead_to(
    scanner: RangeScanner, seed: int, heading: int, radius: float
) -> None:
    """N(p) of the kernel against a walk with shapely from pose to pose."""
    env = scenes.scene(seed, size=4.0, blocks=9, thin=4).transformed(0.1234, 0.017, 0.023)
    theta = TURN * np.arange(3) / 3
    try:
        lattice, possible = standing_lattice(Lattice.over(env, SPACING), scanner, theta, radius)
    except InputError:
        return
    links = lattice.links_among(possible[:, heading])
    steps = np.argwhere(np.hypot(*np.mgrid[-2:3, -2:3]) <= 2) - 2
    walls = shapely.multilinestrings(list(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2))))
    x, y = lattice.points
    known: dict[tuple[int, int], tuple[bool, bool]] = {}

    def stands(row: int, column: int) -> tuple[bool, bool]:
        if (row, column) not in known:
            place = (column + 0.5) * SPACING, (row + 0.5) * SPACING
            known[row, column] = shapely_stands(env, scanner, *place, theta[heading], radius)
        return known[row, column]

    marks, queue = np.empty(25, dtype=np.uint8), np.empty(25, dtype=np.int32)
    cells = lattice.rows_columns
    for p in np.random.default_rng(seed).permutation(len(x))[:8]:
        row, column = (int(v) for v in cells[p])
        first = round(y[p] / SPACING - 0.5), round(x[p] / SPACING - 0.5)
        assert possible[p, heading] == stands(*first)[0] or stands(*first)[1]
        if not possible[p, heading]:
            continue
        reach(row, column, lattice.index, 0, links, steps, 5, STEPS, marks, queue)
        found = {(r, c) for r, c in steps.tolist() if marks[(r + 2) * 5 + c + 2] == 2}
        expected, todo, close = {(0, 0)}, [(0, 0)], False
        while todo:
            r, c = todo.pop()
            for dc, dr in STEPS.tolist():
                to = (r + dr, c + dc)
                if to in expected or math.hypot(*to) > 2:
                    continue
                good, call = stands(first[0] + to[0], first[1] + to[1])
                a = shapely.Point(x[p] + c * SPACING, y[p] + r * SPACING)
                b = shapely.Point(x[p] + to[1] * SPACING, y[p] + to[0] * SPACING)
                close |= call or bool(min(_tips(env, shapely.LineString([a, b]))) < 1e-5)
                if good and not walls.intersects(shapely.LineString([a, b])):
                    expected.add(to)
                    todo.append(to)
        assert close or found == expected


@pytest.mark.slow
@settings(max_examples=8, deadline=None)
@given(
    scanner=mounts(), seed=st.integers(0, 200), heading=st.integers(0, 2),
    radius=st.sampled_from([0.0, 0.15]),
)  # fmt: skip
def test_kernel_agrees_with_the_reference_whatever_the_mount(
    scanner: RangeScanner, seed: int, heading: int, radius: float
) -> None:
    env = scenes.scene(seed, size=4.0, blocks=9, thin=4).transformed(0.1234, 0.017, 0.023)
    tau = independent_tau(scanner)
    try:
        amap = build_map(
            env, scanner, SPACING, RADIUS, headings=3, tau=tau, robot_radius=radius
        ).dataset
    except InputError:
        return
    model = AmbiguityModel(radius=RADIUS, map_std=env.map_std, tau=tau, robot_radius=radius)
    cells = np.argwhere(amap["free"].values)
    theta = TURN * heading / 3
    for row, column in np.random.default_rng(seed).permutation(cells)[:3]:
        x, y = float(amap["x"][column]), float(amap["y"][row])
        if shapely_stands(env, scanner, x, y, theta, radius)[1]:
            continue
        sums = reference.pose_sums(env, scanner, model, SPACING, x, y, theta)
        if np.isnan(sums).all():
            assert np.isnan(amap["level"].values[row, column, heading])
            assert amap["zone"].values[row, column, heading] == NOT_FREE
            continue
        expected = relative_radii(sums[None])
        for name in ("ambiguity", "major", "minor", "level"):
            value = float(amap[name].values[row, column, heading])
            assert value == pytest.approx(float(expected[name][0]), abs=2e-4), name


def test_links_among_and_fewer_points_agree() -> None:
    lattice = Lattice.over(scenes.scene(4, size=4.0, blocks=6, thin=4), 0.2)
    some = np.random.default_rng(0).random(len(lattice.points[0])) < 0.7
    links = lattice.links_among(some)
    assert not links[~some].any()
    np.testing.assert_array_equal(links[some], lattice.among(some).links)
    np.testing.assert_array_equal(lattice.links_among(np.ones_like(some)), lattice.links)


def test_a_sensor_behind_a_thin_wall_is_none_of_ours() -> None:
    """A wall of no thickness between the robot's centre and its sensor, which is in the free."""
    env = scenes.room(2.0, 2.0, np.array([[1.0, 0.0, 1.0, 2.0]]))
    arm = RangeScanner.planar(LASER, 9, 4.0, (0.2, 0.0, 0.0))
    x, y = np.array([0.75, 0.85, 0.95, 1.05]), np.full(4, 1.0)
    assert can_stand(env, arm, x, y, 0.0).tolist() == [True, False, False, True]
    assert can_stand(env, arm, x, y, math.pi).tolist() == [True, True, True, False]


def test_no_room_anywhere_is_said() -> None:
    with pytest.raises(InputError, match=r"a robot of radius 3 m with scanner 'planar scanner'"):
        build_map(
            scenes.room(2.0, 2.0), RangeScanner.planar(LASER, 24, TURN), 0.2, robot_radius=3.0
        )
    with pytest.raises(InputError, match=r"robot_radius is -1\.0; give a number of at least 0"):
        build_map(
            scenes.room(2.0, 2.0), RangeScanner.planar(LASER, 24, TURN), 0.2, robot_radius=-1.0
        )


@pytest.mark.slow
def test_a_body_keeps_off_cells_that_rays_pass() -> None:
    # A single occupied cell in a room of cells of 5 cm: rays pass it, a body does not.
    state = np.full((60, 60), OCCUPIED, dtype=np.uint8)
    state[2:-2, 2:-2] = FREE
    state[30, 30] = OCCUPIED
    env = environment_from_grid(OccupancyGrid(state, 0.05, (0.0, 0.0, 0.0)))
    assert env.is_free(30.5 * 0.05, 30.5 * 0.05)
    scanner = RangeScanner.planar(LASER, 36, TURN)
    x, y = (grid.ravel() for grid in np.meshgrid(*2 * [np.arange(0.25, 2.8, 0.11)]))
    for radius in (0.0, 0.2):
        model = AmbiguityModel(radius=RADIUS, map_std=0.0, tau=1.0, robot_radius=radius)
        found = can_stand(env, scanner, x, y, 0.0, radius)
        expected = [
            reference.stands(env, scanner, model, *at, 0.0) for at in zip(x, y, strict=True)
        ]
        np.testing.assert_array_equal(found, expected)
        # What none of the code above says: how far the cell's square is.
        away = np.hypot(*(np.maximum(np.abs(at - 30.5 * 0.05) - 0.025, 0.0) for at in (x, y)))
        assert found[away == 0.0].all() if radius == 0.0 else not found[away < radius].any()


def test_on_a_wall_itself_nobody_stands() -> None:
    env = scenes.room(4.0, 3.0, np.array([[1.0, 1.0, 3.0, 1.0]]))
    scanner = RangeScanner.planar(LASER, 36, TURN)
    model = AmbiguityModel(radius=RADIUS, map_std=0.0, tau=1.0)
    # On a thin wall, at its end, on the border, and a little off each.
    poses = [(2.0, 1.0), (1.0, 1.0), (0.0, 2.0), (2.0, 1.001), (0.999, 1.0), (0.001, 2.0)]
    x, y = np.array(poses).T
    expected = [False, False, False, True, True, True]
    assert can_stand(env, scanner, x, y, 0.0).tolist() == expected
    assert [reference.stands(env, scanner, model, *at, 0.0) for at in poses] == expected
