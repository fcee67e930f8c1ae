"""Free poses and motions against shapely: distances for discs, sampled footprints for polygons."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.buildings.load import load_environment
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.checker import CollisionChecker, motion_free, pose_free
from ambinav.geometry.collision.polygon_sweep import SKIN
from ambinav.geometry.collision.sweep import line_free
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.curves import motion_length
from ambinav.geometry.motion.steering import Steering
from tests.geometry import scenes

Array = NDArray[Any]

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"
BODY = [(-0.3, -0.25), (0.45, -0.25), (0.55, 0.0), (0.45, 0.25), (-0.3, 0.25)]
FORK = [
    (-0.3, -0.4), (0.5, -0.4), (0.5, -0.25), (0.1, -0.25), (0.1, 0.25), (0.5, 0.25), (0.5, 0.4),
    (-0.3, 0.4),
]  # fmt: skip
TRAILER = [(-0.8, -0.2), (-0.2, -0.2), (-0.2, 0.2), (-0.8, 0.2)]
STEERINGS = [
    Steering("r2"), Steering("se2"), Steering("dubins", 0.8), Steering("reeds-shepp", 0.6),
]  # fmt: skip


def walls(env: Environment) -> shapely.Geometry:
    lines = shapely.multilinestrings(shapely.linestrings(env.segments.xy.reshape(-1, 2, 2)))
    shapely.prepare(lines)
    return lines


def pairs(
    checker: CollisionChecker, count: int, seed: int, longest: float = 4.0
) -> tuple[Array, Array]:
    """Free poses, and poses up to `longest` metres away that may not be free."""
    rng = np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = checker.environment.bounds
    a = rng.uniform((xmin, ymin, -4), (xmax, ymax, 4), (20 * count, 3))
    a = a[checker.poses_free(a)][:count]
    away, angle = rng.uniform(0, longest, len(a)), rng.uniform(-math.pi, math.pi, len(a))
    turn = rng.uniform(-3, 3, len(a))
    return a, a + np.column_stack([away * np.cos(angle), away * np.sin(angle), turn])


def path_of(checker: CollisionChecker, a: Array, b: Array, step: float) -> Array:
    return checker.steering.dense(np.stack([a, b]), step)[0]


@pytest.fixture(scope="module")
def demo() -> Environment:
    return load_environment(DEMO)


# -- poses -------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.0, 0.01, 0.05, 0.25, 0.9, 3.0])
def test_disc_poses_are_the_environments(radius: float, demo: Environment) -> None:
    for env in (demo, scenes.scene(3, size=20.0)):
        rng = np.random.default_rng(1)
        xmin, ymin, xmax, ymax = env.bounds
        poses = rng.uniform((xmin - 1, ymin - 1, -4), (xmax + 1, ymax + 1, 4), (20_000, 3))
        checker = CollisionChecker(env, Footprint.disc(radius), Steering())
        free = checker.poses_free(poses)
        assert (free == env.is_free(poses[:, 0], poses[:, 1], radius)).all()
        assert 0.0 < free.mean() < 1.0 or radius == 3.0


def test_touching_by_exactly_the_radius_is_free() -> None:
    env = scenes.room(8.0, 6.0, np.array([[4.0, 0.0, 4.0, 2.0]]))
    checker = CollisionChecker(env, Footprint.disc(0.25), Steering())
    a = np.array([[0.25, 0.25, 0.0], [0.25, 5.75, 0.0], [4.25, 0.5, 0.0], [3.75, 2.25, 0.0]])
    b = np.array([[3.75, 0.25, 0.0], [7.75, 5.75, 0.0], [4.25, 1.5, 0.0], [4.25, 2.25, 0.0]])
    for poses in (a, b):
        assert checker.poses_free(poses).all()
        assert np.asarray(env.is_free(poses[:, 0], poses[:, 1], 0.25)).all()
    assert checker.motions_free(a, b).all()
    nearer = np.array([[1e-6, 0.0, 0.0]])
    assert not checker.poses_free(a[:1] - nearer).any()
    assert not checker.motions_free(a[2:3], b[2:3] - nearer).any()
    assert not checker.motions_free(a[:1], b[:1] + nearer).any()


@settings(max_examples=30, deadline=None)
@given(radius=st.floats(0.05, 1.0), width=st.floats(3.0, 20.0), x=st.floats(-300.0, 300.0))
def test_touching_is_free_whatever_was_rounded(radius: float, width: float, x: float) -> None:
    env = environment_from_shapes([shapely.box(x, 0.0, x + width, 2.5 * width)])
    checker = CollisionChecker(env, Footprint.disc(radius), Steering())
    for away, free in ((radius, True), (radius - 1e-6, False)):
        poses = np.array([[x + away, width, 0.0], [x + width - away, width, 0.0]])
        assert (checker.poses_free(poses) == free).all()
        assert (np.asarray(env.is_free(poses[:, 0], poses[:, 1], radius)) == free).all()


@pytest.mark.slow(kept=("corners1",))
@pytest.mark.parametrize("corners", [BODY, FORK, TRAILER])
def test_polygon_poses_are_shapelys(corners: list[tuple[float, float]], demo: Environment) -> None:
    for env in (demo, scenes.scene(4, size=20.0)):
        rng = np.random.default_rng(2)
        xmin, ymin, xmax, ymax = env.bounds
        poses = rng.uniform((xmin, ymin, -4), (xmax, ymax, 4), (1500, 3))
        footprint = Footprint.polygon(corners)
        checker = CollisionChecker(env, footprint, Steering("se2"))
        touches = shapely.intersects(footprint.placed(poses), walls(env))
        expected = np.asarray(env.is_free(poses[:, 0], poses[:, 1])) & ~touches
        free = checker.poses_free(poses)
        assert (free == expected).all()
        assert ((checker.clearance(poses) > 0.0) == ~touches).all()


def test_a_speck_inside_of_the_footprint_blocks() -> None:
    speck = np.array([[2.0, 2.0, 2.01, 2.01]])
    env = scenes.room(6.0, 4.0, speck)
    checker = CollisionChecker(env, Footprint.polygon(BODY), Steering("se2"))
    assert not checker.poses_free([[1.7, 2.0, 0.0]])[0]
    assert not checker.motions_free([[1.0, 2.0, 0.0]], [[4.0, 2.0, 0.0]])[0]
    assert not checker.motions_free([[1.0, 2.1, 0.0]], [[4.0, 2.1, 0.3]])[0]
    assert checker.motions_free([[1.0, 2.3, 0.0]], [[4.0, 2.3, 0.0]])[0]


def test_disc_clearance() -> None:
    checker = CollisionChecker(scenes.room(6.0, 4.0), Footprint.disc(0.25), Steering())
    poses = [[1.0, 2.0, 0.0], [0.1, 2.0, 0.0]]
    assert checker.clearance(poses) == pytest.approx([0.75, 0.0])


# -- discs along lines and arcs ----------------------------------------------------------------


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    radius=st.sampled_from([0.0, 1e-3, 0.06, 0.25, 0.7]),
    shift=st.sampled_from([0.0, 1e4]),
)
def test_disc_on_straight_motions_is_exact(seed: int, radius: float, shift: float) -> None:
    env = scenes.scene(seed, size=15.0, blocks=12, thin=6)
    if shift:
        env = env.transformed(0.3, shift, -shift)
    checker = CollisionChecker(env, Footprint.disc(radius), Steering())
    a, b = pairs(checker, 150, seed)
    if not len(a):
        return
    free = checker.motions_free(a, b)
    lines = shapely.linestrings(np.stack([a[:, :2], b[:, :2]], axis=1))
    distance = shapely.distance(lines, walls(env))
    exactly = distance >= radius if radius > 0.0 else distance > 0.0
    wrong = free != exactly
    assert (np.abs(distance[wrong] - radius) < 2e-9).all(), distance[wrong]


@pytest.mark.parametrize("radius", [0.1, 0.25])
def test_disc_in_the_demo_building(radius: float, demo: Environment) -> None:
    checker = CollisionChecker(demo, Footprint.disc(radius), Steering())
    a, b = pairs(checker, 4000, 1)
    free = checker.motions_free(a, b)
    lines = shapely.linestrings(np.stack([a[:, :2], b[:, :2]], axis=1))
    assert (free == (shapely.distance(lines, walls(demo)) >= radius)).all()
    assert 0.2 < free.mean() < 0.9


@pytest.mark.parametrize("steering", STEERINGS[2:])
@pytest.mark.parametrize("radius", [0.02, 0.25])
def test_disc_on_arcs(steering: Steering, radius: float, demo: Environment) -> None:
    step = 0.01
    # What an arc lies beside its chords, at most.
    sagitta = step**2 / (8 * steering.radius)
    for env in (demo, scenes.scene(5, size=15.0)):
        checker = CollisionChecker(env, Footprint.disc(radius), steering)
        a, b = pairs(checker, 300, 3)
        free = checker.motions_free(a, b)
        paths = [path_of(checker, p, q, step) for p, q in zip(a, b, strict=True)]
        lines = [shapely.LineString(path[:, :2]) for path in paths]
        distance = shapely.distance(np.array(lines), walls(env))
        assert (distance[free] >= radius - sagitta - 1e-8).all()
        assert (distance[~free] <= radius + sagitta + 1e-8).all()
        assert 0.05 < free.mean() < 0.95


def test_long_arc_meets_a_wall_in_its_middle() -> None:
    # A half circle of 2 m around (5, 5), whose far side comes within 0.2 m of a short wall.
    env = scenes.room(10.0, 10.0, np.array([[7.2, 4.9, 7.2, 5.1]]))
    a, b = [[5.0, 3.0, 0.0]], [[5.0, 7.0, math.pi]]
    for radius, free in ((0.19, True), (0.21, False)):
        checker = CollisionChecker(env, Footprint.disc(radius), Steering("dubins", 2.0))
        assert checker.motions_free(a, b)[0] == free


@pytest.mark.parametrize("footprint", [Footprint.disc(0.0), Footprint.disc(0.2)])
@pytest.mark.parametrize("steering", STEERINGS)
def test_thin_walls_block(footprint: Footprint, steering: Steering) -> None:
    env = scenes.room(8.0, 4.0, np.array([[4.0, 0.0, 4.0, 4.0]]))
    checker = CollisionChecker(env, footprint, steering)
    y = np.linspace(1.0, 3.0, 50)
    a, b = (np.column_stack([np.full(50, x), y, np.zeros(50)]) for x in (2.0, 6.0))
    assert checker.poses_free(a).all() and checker.poses_free(b).all()
    assert not checker.motions_free(a, b).any()


def test_through_the_end_where_two_walls_meet() -> None:
    # Straight at the corner that two thin walls share: nothing may slip through it.
    for seed in range(50):
        x, y = np.random.default_rng(seed).uniform(2.0, 4.0, 2)
        env = scenes.room(6.0, 6.0, np.array([[x, y, 5.5, 0.5], [x, y, 5.5, 5.5]]))
        checker = CollisionChecker(env, Footprint.disc(0.0), Steering())
        assert not checker.motions_free([[0.5, y, 0.0]], [[5.4, y, 0.0]])[0]


def test_a_motion_of_no_length() -> None:
    env = scenes.room(6.0, 4.0)
    for steering in STEERINGS:
        for footprint in (Footprint.disc(0.25), Footprint.polygon(BODY)):
            checker = CollisionChecker(env, footprint, steering)
            assert checker.motions_free([[3.0, 2.0, 0.4]], [[3.0, 2.0, 0.4]])[0]


def test_out_of_the_map_is_blocked() -> None:
    checker = CollisionChecker(scenes.room(6.0, 4.0), Footprint.disc(0.25), Steering())
    ends = [[9.0, 2.0, 0.0], [1e9, 1e9, 0.0], [3.0, -50.0, 0.0]]
    assert not checker.poses_free(ends).any()
    assert not checker.motions_free([[3.0, 2.0, 0.0]] * 3, ends).any()
    assert not motion_free(0, 0.0, 3.0, 2.0, 0.0, math.nan, 2.0, 0.0, *checker.arrays)
    assert not pose_free(math.nan, 2.0, 0.0, *checker.arrays)


# -- polygons ----------------------------------------------------------------------------------


def least_distance(checker: CollisionChecker, a: Array, b: Array, step: float) -> float:
    """From the footprint and the reference point along a motion to the nearest wall.

    The footprint is taken at points at most `step` metres, and as many radians, apart.
    """
    length = max(float(checker.steering.lengths(a[None], b[None])[0]), 1e-9)
    rate = abs(float(b[2] - a[2])) if checker.steering.space == "se2" else 0.0
    path = path_of(checker, a, b, step * length / (length + rate))
    tree = shapely.STRtree(shapely.linestrings(checker.environment.segments.xy.reshape(-1, 2, 2)))
    shapes = [*checker.footprint.placed(path), shapely.LineString(path[:, :2])]
    return float(tree.query_nearest(shapes, all_matches=False, return_distance=True)[1].min())


@pytest.mark.slow(
    kept=("steering0-corners0", "steering1-corners1", "steering2-corners2", "steering3-corners0")
)
@pytest.mark.parametrize("corners", [BODY, FORK, TRAILER])
@pytest.mark.parametrize("steering", STEERINGS)
def test_polygon_motions(
    corners: list[tuple[float, float]], steering: Steering, demo: Environment
) -> None:
    step = 0.02
    found = []
    for env in (demo, scenes.scene(6, size=15.0)):
        checker = CollisionChecker(env, Footprint.polygon(corners), steering)
        a, b = pairs(checker, 60, 5, longest=6.0 if steering.space == "r2" else 2.5)
        if steering.space == "r2":
            # The end must leave room to turn; that is tested below.
            there = checker.poses_free(b)
            a, b = a[there], b[there]
        free = checker.motions_free(a, b)
        for p, q, is_free in zip(a, b, free, strict=True):
            distance = least_distance(checker, p, q, step)
            if is_free:
                assert distance > 0.0
            else:
                # The samples may miss the nearest place by what a corner moves in half a step.
                assert distance <= SKIN + 0.5 * step * (1 + 2 * checker.footprint.outer)
        found.extend(free)
    assert 0.05 < np.mean(found) < 1.0


def test_polygon_that_keeps_its_heading_is_exact() -> None:
    # Half the width is 0.25 m; the box passes a gap of 0.5 m with a micrometre to spare.
    for gap, free in ((0.500002, True), (0.499998, False)):
        posts = np.array([[4.0, 0.0, 4.0, 2.0 - gap / 2], [4.0, 2.0 + gap / 2, 4.0, 4.0]])
        env = scenes.room(8.0, 4.0, posts)
        box = Footprint.polygon([(-0.4, -0.25), (0.4, -0.25), (0.4, 0.25), (-0.4, 0.25)])
        for steering in (Steering("r2"), Steering("se2"), Steering("reeds-shepp", 1.0)):
            checker = CollisionChecker(env, box, steering)
            there, back = [[2.0, 2.0, 0.0]], [[6.0, 2.0, 0.0]]
            assert checker.motions_free(there, back)[0] == free
            if steering.space != "r2":
                assert checker.motions_free(back, there)[0] == free
        assert not CollisionChecker(env, Footprint.disc(0.3), Steering()).motions_free(
            [[2.0, 2.0, 0.0]], [[6.0, 2.0, 0.0]]
        )[0]


def test_turning_polygon_uses_the_room_but_for_the_skin() -> None:
    box = Footprint.polygon([(-0.4, -0.25), (0.4, -0.25), (0.4, 0.25), (-0.4, 0.25)])
    for spare, free in ((0.002, True), (-1e-6, False)):
        half = box.outer + spare
        env = scenes.environment(shapely.box(-half, -half, half, half))
        checker = CollisionChecker(env, box, Steering("se2"))
        turns = np.linspace(0.7, 3.0, 20)
        b = np.column_stack([np.zeros(20), np.zeros(20), turns])
        assert (checker.motions_free(np.zeros((20, 3)), b) == free).all()
        assert (checker.motions_free(np.zeros((20, 3)), -b) == free).all()


def test_r2_leaves_room_to_turn_at_the_ends() -> None:
    # A corridor 0.7 m wide: the box drives through it but cannot turn in it.
    parts = [shapely.box(0, 0, 3, 4), shapely.box(3, 1.65, 6, 2.35), shapely.box(6, 0, 9, 4)]
    env = scenes.environment(shapely.union_all(parts))
    box = Footprint.polygon([(-0.4, -0.25), (0.4, -0.25), (0.4, 0.25), (-0.4, 0.25)])
    start, within, end = [[1.5, 2.0, 0.0]], [[4.5, 2.0, 0.0]], [[7.5, 2.0, 0.0]]
    r2, se2 = (CollisionChecker(env, box, Steering(space)) for space in ("r2", "se2"))
    assert r2.motions_free(start, end)[0] and se2.motions_free(start, end)[0]
    assert not r2.poses_free(within)[0] and not r2.motions_free(start, within)[0]
    assert se2.poses_free(within)[0] and se2.motions_free(start, within)[0]
    assert "turn on the spot" in str(r2.why_not(4.5, 2.0))


@pytest.mark.slow
def test_on_a_recorded_map(data_dir: Path) -> None:
    env = load_environment(data_dir / "maps" / "willow_full_005.yaml")
    checker = CollisionChecker(env, Footprint.disc(0.25), Steering())
    a, b = pairs(checker, 5000, 1)
    free = checker.motions_free(a, b)
    tree = shapely.STRtree(shapely.linestrings(env.collision.segments.xy.reshape(-1, 2, 2)))
    lines = shapely.linestrings(np.stack([a[:, :2], b[:, :2]], axis=1))
    _, distance = tree.query_nearest(lines, all_matches=False, return_distance=True)
    assert (free == (distance >= 0.25)).all()


# -- forbidden cells ---------------------------------------------------------------------------


@pytest.mark.parametrize("steering", STEERINGS)
def test_forbidden_cells_are_those_under_the_path(steering: Steering) -> None:
    env = scenes.room(12.0, 12.0)
    rng = np.random.default_rng(8)
    forbidden = rng.random((100, 90)) < 0.02
    origin, spacing = (1.03, 0.98), 0.1
    checker = CollisionChecker(
        env, Footprint.disc(0.1), steering, forbidden=forbidden, origin=origin, spacing=spacing
    )
    a, b = pairs(checker, 300, 9)
    free = checker.motions_free(a, b)
    without = CollisionChecker(env, Footprint.disc(0.1), steering).motions_free(a, b)
    assert not free[~without].any()
    rows, columns = np.nonzero(forbidden)
    x, y = origin[0] + columns * spacing, origin[1] + rows * spacing
    half = spacing / 2
    cells = shapely.union_all(shapely.box(x - half, y - half, x + half, y + half))
    shapely.prepare(cells)
    for i in np.flatnonzero(without):
        line = shapely.LineString(path_of(checker, a[i], b[i], 0.002)[:, :2])
        met = line.intersection(cells).length
        # A corner may be cut by no more than a hundredth of a cell.
        assert free[i] == (met == 0.0) or met < (0.03 if steering.turns else 1e-9)
    assert 0.05 < free.mean() < 0.8
    cell = np.column_stack([x, y, np.zeros(len(x))])
    assert not checker.poses_free(cell).any()
    assert checker.why_not(*cell[0]) == "in a forbidden zone"


def test_past_corners_of_forbidden_cells_both_ways_are_alike() -> None:
    forbidden = np.random.default_rng(3).random((20, 20)) < 0.3
    env, disc = scenes.room(6.0, 6.0), Footprint.disc(0.1)
    checker = CollisionChecker(
        env, disc, STEERINGS[0], forbidden=forbidden, origin=(0.5, 0.5), spacing=0.25
    )
    rng = np.random.default_rng(4)
    a = rng.integers(0, 20, (4000, 2))
    b = np.clip(a + rng.integers(-3, 4, a.shape), 0, 19)
    poses = [0.5 + 0.25 * np.column_stack([cells, np.zeros(len(a))]) for cells in (a, b)]
    there = checker.motions_free(*poses)
    assert (there == checker.motions_free(*poses[::-1])).all()
    # Diagonally past a closed cell, but not between two of them.
    diagonal = (np.abs(b - a) == 1).all(axis=1)
    ends = forbidden[a[:, 1], a[:, 0]] | forbidden[b[:, 1], b[:, 0]]
    between = forbidden[a[:, 1], b[:, 0]] & forbidden[b[:, 1], a[:, 0]]
    assert (there == ~(ends | between))[diagonal].all()


def test_a_disc_s_line_is_its_motion_in_the_plane(demo: Environment) -> None:
    rng = np.random.default_rng(17)
    for forbidden in (None, rng.random((60, 90)) < 0.05):
        zones = {} if forbidden is None else {"forbidden": forbidden}
        checker = CollisionChecker(
            demo, Footprint.disc(0.25), STEERINGS[0], **zones, origin=(5.0, 5.0), spacing=0.2
        )
        a, b = pairs(checker, 300, 18)
        lines = [line_free(*p[:2], *q[:2], *checker.arrays) for p, q in zip(a, b, strict=True)]
        assert (checker.motions_free(a, b) == lines).all()
        assert 0.1 < np.mean(lines) < 0.9


# -- all of it alike ---------------------------------------------------------------------------


@pytest.mark.parametrize("steering", STEERINGS)
def test_kernel_alone_and_batch_agree(steering: Steering, demo: Environment) -> None:
    for footprint in (Footprint.disc(0.25), Footprint.polygon(BODY)):
        checker = CollisionChecker(demo, footprint, steering)
        a, b = pairs(checker, 200, 11)
        one = [
            motion_free(steering.kind, steering.radius, *p, *q, *checker.arrays)
            for p, q in zip(a, b, strict=True)
        ]
        assert (checker.motions_free(a, b) == one).all()
        free = [pose_free(*q, *checker.arrays) for q in b]
        assert (checker.poses_free(b) == free).all()
        # Whoever arrives is in a free place.
        assert np.asarray(free)[np.asarray(one)].all()


@pytest.mark.parametrize("angle", [0.3, 1.2])
def test_turned_building_gives_the_same(angle: float) -> None:
    env = scenes.scene(9, size=15.0)
    for steering in STEERINGS:
        checker = CollisionChecker(env, Footprint.disc(0.25), steering)
        a, b = pairs(checker, 500, 12)
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        shift = np.array([3.0, -2.0, angle])
        turned = CollisionChecker(env.transformed(angle, 3.0, -2.0), Footprint.disc(0.25), steering)
        same = turned.motions_free(a @ turn + shift, b @ turn + shift)
        assert (same == checker.motions_free(a, b)).mean() > 0.998


@pytest.mark.parametrize("space", ["dubins", "reeds-shepp"])
def test_a_curve_without_a_radius_is_never_free(space: str) -> None:
    curve = Steering(space, radius=0.5)
    checker = CollisionChecker(scenes.room(6.0, 4.0), Footprint.disc(0.25), curve)
    motion = (2.0, 2.0, 0.0, 3.0, 2.0, 0.0)
    assert motion_free(curve.kind, 0.5, *motion, *checker.arrays)
    assert not motion_free(curve.kind, None, *motion, *checker.arrays)
    assert math.isnan(motion_length(curve.kind, None, *motion))
