"""Rays in space through prisms: against every face one by one, Embree, and known cases."""

from __future__ import annotations

import math

import numba
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity

from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceRays
from ambinav.geometry.segments import REFLECTOR, WALL
from ambinav.runtime.errors import InputError
from tests.casting.prism_reference import Array, cast_slowly

REACH = 40.0
EXACT = 1e-4


def box(x: float, y: float, wide: float, deep: float, low: float, high: float) -> Solid:
    return Solid(shapely.box(x, y, x + wide, y + deep), low, high)


def unit(direction: Array) -> Array:
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def hall() -> tuple[list[Solid], list[tuple[float, ...]]]:
    """Turned blocks, an L, a ring with a hole, a table with a vase and legs, and sheets."""
    rng = np.random.default_rng(4)
    solids = []
    for _ in range(25):
        x, y, low = *rng.uniform(0, 20, 2), rng.choice([0.0, 0.4, 1.5])
        block = shapely.box(x, y, x + rng.uniform(0.1, 3), y + rng.uniform(0.1, 2))
        turned = affinity.rotate(block, rng.uniform(0, 90))
        solids.append(Solid(turned, float(low), float(low + rng.uniform(0.05, 1.5))))
    ell = shapely.Polygon([(1, 1), (4, 1), (4, 2), (2, 2), (2, 4), (1, 4)])
    ring = shapely.Point(12, 12).buffer(2.0) - shapely.Point(12, 12).buffer(1.5)
    solids += [Solid(ell, 0.5, 0.6), Solid(ring, 1.0, 1.2)]
    solids += [box(8, 3, 2, 1, 0.7, 0.75), box(8.5, 3.3, 0.2, 0.2, 0.75, 1.1)]
    solids += [box(8, 3, 0.1, 0.1, 0.0, 0.7), box(9.9, 3.9, 0.1, 0.1, 0.0, 0.7)]
    sheets = [(0, 0, 20, 0, 0, 3), (20, 0, 20, 20, 0, 3), (5, 15, 9, 16, 0.3, 1.1)]
    return solids, [tuple(map(float, sheet)) for sheet in sheets]


def prisms_of(solids: list[Solid], sheets: list[tuple[float, ...]]) -> Prisms:
    walls = np.array(sheets)
    return Prisms(walls[:, :4], walls[:, 4:], solids=solids, floor=0.0, ceiling=3.0)


def random_rays(count: int, seed: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(seed)
    origin = rng.uniform((-2, -2, 0.05), (22, 22, 2.95), (count, 3))
    return origin, unit(rng.normal(size=(count, 3)) * (1.0, 1.0, 0.4))


# -- against every face ------------------------------------------------------------------------


def test_cast_is_that_of_every_face_one_by_one() -> None:
    solids, sheets = hall()
    origin, direction = random_rays(4000, 1)
    distance, surface = prisms_of(solids, sheets).cast(origin, direction, REACH)
    expected = np.minimum(cast_slowly(solids, sheets, 0.0, 3.0, origin, direction), REACH)
    assert np.abs(distance - expected).max() < 1e-6
    assert ((surface >= 0) == (expected < REACH)).all()


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.4, -0.2)])
def test_a_scan_is_its_rays_one_by_one(tilt: tuple[float, float]) -> None:
    solids, sheets = hall()
    prisms = prisms_of(solids, sheets)
    rng = np.random.default_rng(2)
    x, y, theta = rng.uniform(0, 20, (3, 150))
    rays = SpaceRays.layers(np.radians([-90, -40, -5, 0, 5, 40, 90]), rng.uniform(-4, 4, 30), 0.2)
    rays = rays.mounted(0.2, -0.1, 0.3, 0.7, *tilt)
    distance, surface, incidence = prisms.cast_scans(x, y, theta, rays, REACH)
    origin, direction = rays.at(x, y, theta)
    expected, of = prisms.cast(origin, direction, REACH)
    free = ~np.isnan(distance)
    assert 0.5 < free.mean() < 1.0  # some poses are in a block
    assert np.abs(np.minimum(distance, REACH) - expected)[free].max() < 1e-5
    assert (surface == of)[free].mean() > 0.999
    facing = np.abs((direction * prisms.surface_normal[surface]).sum(axis=-1))
    hit = surface >= 0
    assert np.abs(np.cos(incidence) - facing)[hit].max() < 1e-6
    assert np.isnan(incidence[~hit]).all()


@pytest.mark.slow
@settings(max_examples=25)
@given(
    seed=st.integers(0, 1000),
    count=st.integers(1, 400),
    sensors=st.integers(1, 3),
    spread=st.sampled_from([0.05, 1.0, 4.0]),
)
def test_rays_of_many_azimuths_walk_together_as_alone(
    seed: int, count: int, sensors: int, spread: float
) -> None:
    prisms = prisms_of(*hall())
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-spread, spread, count) + rng.choice([0.0, np.pi / 4, np.pi / 2, 9.0])
    mount = rng.uniform((-0.5, -0.5, 0.2), (0.5, 0.5, 2.5), (sensors, 3))
    rays = SpaceRays(
        mount[rng.integers(sensors, size=count)], azimuth, rng.uniform(-1.5, 1.5, count)
    )
    # Many start beside all walls, in front of them and behind.
    x, y, theta = rng.uniform((-8, -8, -4), (28, 28, 4), (20, 3)).T
    distance, surface, _ = prisms.cast_scans(x, y, theta, rays, REACH)
    expected, of = prisms.cast(*rays.at(x, y, theta), REACH)
    free = ~np.isnan(distance)
    assert np.abs(np.minimum(distance, REACH) - expected)[free].max(initial=0.0) < 1e-5
    assert (surface == of)[free].mean() > 0.999


@settings(max_examples=25)
@given(
    blocks=st.lists(
        st.tuples(
            st.integers(0, 8), st.integers(0, 8), st.integers(1, 3), st.integers(1, 3),
            st.integers(0, 3), st.integers(1, 3), st.sampled_from([0.0, 30.0, 45.0]),
        ),
        min_size=1, max_size=8,
    ),
    seed=st.integers(0, 1000),
)  # fmt: skip
def test_touching_stacked_and_overlapping_solids(
    blocks: list[tuple[int, int, int, int, int, int, float]], seed: int
) -> None:
    # On a raster: many faces lie in one plane, and many edges on each other.
    solids = [
        Solid(affinity.rotate(shapely.box(x, y, x + w, y + d), turn, origin=(0, 0)), z, z + h)
        for x, y, w, d, z, h, turn in blocks
    ]
    rng = np.random.default_rng(seed)
    origin = rng.uniform((-3, -3, 0.01), (11, 11, 6.9), (300, 3))
    direction = unit(rng.normal(size=(300, 3)))
    distance, _ = Prisms(solids=solids, floor=0.0).cast(origin, direction, REACH)
    expected = np.minimum(cast_slowly(solids, [], 0.0, None, origin, direction), REACH)
    assert np.abs(distance - expected).max() < 1e-6


@pytest.mark.slow
def test_embree_agrees() -> None:
    pytest.importorskip("embreex", reason="embreex is not installed")
    from prism_mesh import embree_scene, office, poses, vlp16

    prisms, rays = office(3, 1), vlp16(90)
    at = poses(prisms, 60, np.random.default_rng(3))
    distance, _, _ = prisms.cast_scans(*at.T, rays, REACH, incidence=False)
    origin, direction = (part.reshape(-1, 3).astype(np.float32) for part in rays.at(*at.T))
    limit = np.full(len(origin), REACH, dtype=np.float32)
    theirs = embree_scene(prisms).run(origin, direction, limit, query="DISTANCE")
    gap = np.abs(np.minimum(distance.ravel(), REACH) - theirs)
    # Embree works in float32: near an edge it may find what is beside it, and grazing a face it
    # is off by a little more.
    assert (gap > EXACT).sum() <= 2
    assert np.quantile(gap, 0.999) < EXACT / 10


# -- what is known beforehand ------------------------------------------------------------------


@pytest.fixture(scope="module")
def table_room() -> Prisms:
    """A room of 6 x 4 x 3 m with a table of 2 x 1 m, its top between 0.70 and 0.75 m."""
    sheets = [(0, 0, 6, 0), (6, 0, 6, 4), (6, 4, 0, 4), (0, 4, 0, 0)]
    return Prisms(
        sheets, [(0.0, 3.0)] * 4, [WALL, WALL, REFLECTOR, WALL],
        solids=[box(2, 1, 2, 1, 0.70, 0.75)], floor=0.0, ceiling=3.0,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("origin", "direction", "distance", "surface"),
    [
        ((3, 1.5, 2.0), (0, 0, -1), 1.25, 9),  # straight down onto the table
        ((3, 1.5, 0.2), (0, 0, 1), 0.50, 8),  # straight up under it
        ((1, 1.5, 2.0), (0, 0, -3), 2.00, 10),  # down beside it, a vector of no unit length
        ((1, 1.5, 2.0), (0, 0, 1), 1.00, 11),  # up to the ceiling
        ((2, 1.0, 2.0), (0, 0, -1), 1.25, 9),  # down onto its corner
        ((0.5, 1.5, 0.72), (1, 0, 0), 1.5, 6),  # level, against its edge
        ((0.5, 1.5, 0.75), (1, 0, 0), 1.5, 6),  # level, in the plane of its top: its edge
        ((0.5, 1.5, 0.75 + 1e-6), (1, 0, 0), 5.5, 1),  # just over it
        ((0.5, 1.0, 0.72), (1, 0, 0), 1.5, None),  # in the plane of a side: its corner
        ((0.5, 1.0 - 1e-6, 0.72), (1, 0, 0), 5.5, 1),  # just beside it
        ((0.5, 3.5, 1.0), (0, 1, 0), 0.5, 2),  # the reflector
        ((1.0, 1.0, 1.0), (-1, -1, 0), math.sqrt(2), None),  # into a corner of the room
        ((1.0, 2.0, 1.0), (-1, 0, 2), math.sqrt(5), None),  # where wall and ceiling meet
        ((1.0, 2.0, 1.0), (-1, 0, -1), math.sqrt(2), None),  # where wall and floor meet
        ((0.0, 2.0, 1.0), (0, 1, 0), 2.0, 2),  # along a wall, in its plane, to the next one
        ((-3.0, 2.0, 1.0), (1, 0, 0), 3.0, 3),  # from beyond all walls
        ((-3.0, 2.0, 1.0), (-1, 0, 0), 9.0, -1),  # and away from them
    ],
)
def test_known_rays(
    table_room: Prisms, origin: Array, direction: Array, distance: float, surface: int | None
) -> None:
    found, of = table_room.cast(np.array(origin, float), np.array(direction, float), 9.0)
    assert found == pytest.approx(distance, abs=1e-8)
    assert surface is None or of == surface
    if surface == 2:
        assert table_room.surface_kind[of] == REFLECTOR


def test_nearly_upright_rays(table_room: Prisms) -> None:
    for off in (1e-3, 1e-6, 1e-8, 1e-9, 1e-10, 1e-14):
        rays = SpaceRays(np.array([[0.0, 0.0, 2.0]]), np.zeros(1), np.array([-math.pi / 2 + off]))
        x, y, theta = np.array([3.0]), np.array([1.5]), np.array([0.3])
        distance, surface, _ = table_room.cast_scans(x, y, theta, rays, 9.0)
        assert distance[0, 0] == pytest.approx(1.25 / math.cos(off), abs=1e-6)
        assert surface[0, 0] == 9


def test_no_ray_leaks_at_edges_and_corners() -> None:
    # A closed box of solids that only touch, and every ray aimed at where two of them meet.
    turn = 0.3
    walls = [
        (-1, -1, 8, 1, 0, 1), (-1, -1, 8, 1, 1, 2), (-1, 4, 8, 1, 0, 2),
        (-1, 0, 1, 4, 0, 2), (6, 0, 1, 4, 0, 2), (-1, -1, 8, 6, 2, 3), (-1, -1, 8, 6, -1, 0),
    ]  # fmt: skip
    solids = [
        Solid(affinity.rotate(shapely.box(x, y, x + w, y + d), turn, (0, 0), True), a, b)
        for x, y, w, d, a, b in walls
    ]
    k = np.linspace(0, 1, 1001)
    edges = [((0, 0, z), (6, 0, z)) for z in (0, 1, 2)] + [((0, 0, 0), (0, 0, 2))]
    edges += [((0, 4, 2), (6, 4, 2)), ((6, 0, 0), (6, 4, 0)), ((0, 4, 0), (0, 4, 2))]
    targets = np.concatenate([np.outer(1 - k, a) + np.outer(k, b) for a, b in edges])
    c, s = math.cos(turn), math.sin(turn)
    spin = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    origin = np.array([2.7, 1.9, 1.1]) @ spin.T
    aim = targets @ spin.T - origin
    distance, _ = Prisms(solids=solids).cast(origin, aim, 50.0)
    assert np.abs(distance - np.linalg.norm(aim, axis=1)).max() < 1e-7


def test_what_starts_in_a_solid_or_beyond_the_planes_is_nan(table_room: Prisms) -> None:
    rays = SpaceRays.layers(np.array([0.0, -math.pi / 2]), np.array([0.0, 1.0]), 0.72)
    x, y, theta = np.array([3.0, 1.0, 9.0]), np.array([1.5, 1.5, 1.5]), np.zeros(3)
    distance, surface, incidence = table_room.cast_scans(x, y, theta, rays, 9.0)
    assert np.isnan(distance).all(axis=1).tolist() == [True, False, False]
    assert (surface[0] == -1).all() and np.isnan(incidence[0]).all()
    for height in (-0.1, 3.1):
        beyond = SpaceRays.layers(np.zeros(1), np.zeros(1), height)
        assert np.isnan(table_room.cast_scans(x, y, theta, beyond, 9.0)[0]).all()


def test_order_of_rays_and_threads_change_no_bit() -> None:
    solids, sheets = hall()
    prisms = prisms_of(solids, sheets)
    rng = np.random.default_rng(5)
    x, y, theta = rng.uniform(0, 20, (3, 200))
    rays = SpaceRays.layers(rng.uniform(-0.5, 0.5, 8), rng.uniform(-3, 3, 40), 0.5)
    order = rng.permutation(320)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        one = prisms.cast_scans(x, y, theta, rays, REACH)
        numba.set_num_threads(before)
        two = prisms.cast_scans(x, y, theta, SpaceRays(*(part[order] for part in rays)), REACH)
    finally:
        numba.set_num_threads(before)
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a[:, order], b, equal_nan=True)


def test_a_mount_turns_directions_as_ros_does() -> None:
    rays = SpaceRays.layers(np.zeros(1), np.zeros(1), 0.0).mounted(1.0, 2.0, 3.0, 0.0, 0.2, 0.0)
    assert rays.elevation[0] == pytest.approx(-0.2)  # pitch looks down
    assert rays.origin[0].tolist() == [1.0, 2.0, 3.0]
    left = SpaceRays.layers(np.zeros(1), np.array([math.pi / 2]), 0.0).mounted(0, 0, 0, 0, 0, 0.2)
    assert left.elevation[0] == pytest.approx(0.2)  # roll lifts the left
    level = SpaceRays.layers(np.array([0.1]), np.array([0.3]), 0.0).mounted(0, 0, 0, 0.5, 0, 0)
    assert (level.azimuth[0], level.elevation[0]) == (0.3 + 0.5, 0.1)


# -- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({}, "nothing stands"),
        ({"xy": [(0, 0, 1, 0)], "z": [(1.0, 1.0)]}, "wall 0 stands from z = 1 to 1 m"),
        ({"xy": [(0, 0, 1, math.nan)], "z": [(0.0, 1.0)]}, "not finite"),
        ({"xy": [(0, 0, 1, 0)], "z": []}, "1 walls, 0 heights"),
        ({"xy": [(0, 0, 0, 0)], "z": [(0.0, 1.0)]}, "nothing stands"),
        ({"solids": [box(0, 0, 1, 1, 2, 1)]}, "solid 0 stands from z = 2 to 1 m"),
        ({"solids": [box(0, 0, 1, 1, 0, math.inf)]}, "finite heights"),
        ({"solids": [Solid(shapely.Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), 0, 1)]}, "outline"),
        ({"solids": [box(0, 0, 1, 1, 0, 1)], "floor": 2.0, "ceiling": 1.0}, "the floor is at"),
        ({"solids": [box(0, 0, 1, 1, 0, 1)], "floor": math.nan}, "floor is nan"),
    ],
)
def test_refused(arguments: dict[str, object], text: str) -> None:
    with pytest.raises(InputError, match=text):
        Prisms(**arguments)  # type: ignore[arg-type]


def test_rays_that_are_not_finite_are_nan(table_room: Prisms) -> None:
    origin = np.array([[1.0, 1.0, math.nan], [1.0, 1.0, 1.0], [1.0, math.inf, 1.0]])
    direction = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    distance, surface = table_room.cast(origin, direction, 9.0)
    assert np.isnan(distance).all() and (surface == -1).all()
    with pytest.raises(InputError, match="max_range is -1"):
        table_room.cast(origin, direction, -1)
