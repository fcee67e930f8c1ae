"""Codes of the layer `judged` against computations that share no code with it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from PIL import Image, ImageDraw
from scipy import ndimage
from shapely import affinity

import ambinav as an
from ambinav.geometry.collision.reach import reach_of
from ambinav.geometry.obstacle import Obstacle
from ambinav.maps.judged_floor import (
    JUDGED,
    NOT_REACHABLE,
    OUTSIDE,
    TOO_CLOSE,
    UNEXPLORED_FLOOR,
    FloorJudge,
)
from ambinav.maps.zones import UNEXPLORED
from tests.judged.buildings import LASER, on_a_page, seen_in_part

STEP = 0.02
"""Of the fine grid, metres."""
SIZE = 12.0, 8.0


def rooms(rng: np.random.Generator) -> shapely.Geometry:
    """Rooms beside each other with doors of random widths, and boxes that stand in them."""
    floor = []
    edges = [0.2, *np.sort(rng.uniform(2.0, 10.0, 2)).tolist(), SIZE[0] - 0.2]
    for left, right in itertools.pairwise(edges):
        floor.append(shapely.box(left, 0.2, max(right - 0.2, left + 0.3), SIZE[1] - 0.2))
    for edge in edges[1:-1]:
        low, wide = rng.uniform(1.0, 6.0), rng.uniform(0.2, 1.0)
        floor.append(shapely.box(edge - 0.4, low, edge + 0.2, low + wide))
    boxes = [
        affinity.rotate(shapely.box(x, y, x + w, y + h), angle)
        for x, y, w, h, angle in rng.uniform(
            (0.5, 0.5, 0.1, 0.1, 0.0), (11.0, 7.0, 1.5, 1.0, 90.0), (14, 5)
        ).tolist()
    ]
    whole = shapely.union_all(floor).difference(shapely.union_all(boxes))
    return shapely.multipolygons([p for p in shapely.get_parts(whole).tolist() if p.area > 0.01])


def pixels(floor: shapely.Geometry) -> NDArray[np.bool_]:
    """The floor on the fine grid, row 0 at y = 0."""
    image = Image.new("1", (round(SIZE[0] / STEP), round(SIZE[1] / STEP)))
    draw = ImageDraw.Draw(image)
    for part in shapely.get_parts(floor).tolist():
        for ring, fill in ((part.exterior, 1), *((hole, 0) for hole in part.interiors)):
            draw.polygon([(x / STEP - 0.5, y / STEP - 0.5) for x, y in ring.coords], fill=fill)
    return np.asarray(image)


def expected(
    free: NDArray[np.bool_], radius: float, start: tuple[float, float]
) -> NDArray[np.uint8] | None:
    """Codes of the fine grid by distance transform and flood; None: no room at the start."""
    room = ndimage.distance_transform_edt(free) * STEP >= radius
    label, _ = ndimage.label(room, np.ones((3, 3)))
    here = label[int(start[1] / STEP), int(start[0] / STEP)]
    if here == 0:
        return None
    return np.where(label == here, JUDGED, np.where(room, NOT_REACHABLE, TOO_CLOSE)).astype(
        np.uint8
    )


@pytest.mark.parametrize("seed", range(12))
def test_reach_agrees_with_a_flood_on_a_fine_grid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    floor = rooms(rng)
    env = an.environment_from_shapes(shapely.get_parts(floor).tolist(), name="rooms")
    radius = float(rng.uniform(0.1, 0.45))
    x, y = np.arange(0.05, SIZE[0], 0.1), np.arange(0.05, SIZE[1], 0.1)
    free = np.asarray(env.is_free(*np.meshgrid(x, y)))
    fine = pixels(floor)
    deep = ndimage.distance_transform_edt(fine)
    row, column = np.unravel_index(deep.argmax(), deep.shape)
    start = float((column + 0.5) * STEP), float((row + 0.5) * STEP)
    # Where a little more or less room would change nothing, pixels and polygons must agree.
    near = [expected(fine, radius + slack, start) for slack in (-0.04, 0.0, 0.04)]
    codes = FloorJudge.for_robot(env, radius, start).codes(free, None, x, y)
    at = np.ix_((y / STEP).astype(int), (x / STEP).astype(int))
    agreed = [code[at] for code in near if code is not None]
    assert len(agreed) == 3
    certain = free & (agreed[0] == agreed[1]) & (agreed[1] == agreed[2])
    assert certain.sum() > 0.5 * free.sum()
    np.testing.assert_array_equal(codes[certain], agreed[1][certain])


def test_unexplored_floor_is_what_the_beams_say() -> None:
    amap = an.build_map(seen_in_part(), LASER, spacing=0.25, store=False)
    code, unknown = amap.judged.code, amap.dataset["unknown"].values
    reached = (code == JUDGED) | (code == UNEXPLORED_FLOOR) | (code == OUTSIDE)
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    # The disc of 0.2 m in a hall of 14 x 4 m.
    inside = (np.abs(x - 7.0) <= 6.8) & (np.abs(y - 2.0) <= 1.8)
    np.testing.assert_array_equal(reached, inside & amap.dataset["free"].values)
    np.testing.assert_array_equal(code == UNEXPLORED_FLOOR, reached & (unknown >= UNEXPLORED))


def test_a_robot_in_the_margin_is_judged_there() -> None:
    env = on_a_page()
    amap = an.build_map(env, LASER, spacing=0.25, store=False)
    there = amap.for_robot(reach_of(env, 0.2, (1.0, 1.0)))
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    margin = (x < 3.9) | (x > 22.1) | (y < 3.9) | (y > 12.1)
    counted = there.judged.counted | there.judged.unexplored | there.judged.outside
    assert not (counted & ~margin).any()
    # 0.2 m less on either side.
    assert counted.sum() * 0.25**2 == pytest.approx(25.6 * 15.6 - 18.4 * 8.4, rel=0.05)
    assert (amap.judged.code[margin & amap.judged.outside] == OUTSIDE).all()
    assert there.for_robot(reach_of(env, 0.2)).judged.code.tolist() == amap.judged.code.tolist()


def test_a_robot_that_fits_nowhere_has_no_judged_floor() -> None:
    env = an.environment_from_shapes([shapely.box(0.0, 0.0, 3.0, 0.3)], name="shaft")
    amap = an.build_map(env, LASER, spacing=0.1, store=False)
    judged = amap.judged
    assert judged.counted.sum() == 0 and judged.reachable.sum() == 0
    np.testing.assert_array_equal(judged.beside_walls, amap.dataset["free"].values)


# -- invariances --------------------------------------------------------------------------------


def judged_at(env: an.Environment, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray:
    """Codes of a lattice for a robot of 0.2 m, all of it explored."""
    free = np.asarray(env.is_free(*np.meshgrid(x, y)))
    return FloorJudge.for_robot(env, 0.2).codes(free, None, x, y)


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_pieces_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(100 + seed)
    parts = shapely.get_parts(rooms(rng)).tolist()
    parts += [affinity.translate(part, 15.0) for part in parts[:2]]
    x, y = np.arange(0.05, 30.0, 0.1), np.arange(0.05, 8.0, 0.1)
    first = judged_at(an.environment_from_shapes(parts, name="a"), x, y)
    for _ in range(3):
        rng.shuffle(parts)
        env = an.environment_from_shapes([shapely.reverse(part) for part in parts], name="b")
        np.testing.assert_array_equal(judged_at(env, x, y), first)


@pytest.mark.parametrize("quarter", [1, 2, 3])
def test_quarter_turns_and_moves_turn_the_codes(quarter: int) -> None:
    floor = rooms(np.random.default_rng(7))
    x, y = np.arange(0.05, SIZE[0], 0.1), np.arange(0.05, SIZE[1], 0.1)
    first = judged_at(an.environment_from_shapes(shapely.get_parts(floor).tolist()), x, y)
    turned = affinity.translate(
        affinity.rotate(floor, 90 * quarter, origin=(0.0, 0.0)), 100.0, -40.0
    )
    axes = {1: (-y[::-1], x), 2: (-x[::-1], -y[::-1]), 3: (y, -x[::-1])}[quarter]
    env = an.environment_from_shapes(shapely.get_parts(turned).tolist())
    found = judged_at(env, axes[0] + 100.0, axes[1] - 40.0)
    # Rows rise with y: seen from above that is a turn the other way round.
    expected_codes = np.rot90(first, -quarter)
    assert (found != expected_codes).mean() < 1e-3  # what lies on an edge may round either way


@pytest.mark.parametrize("degrees", [6.0, 17.0, 45.0, 71.3])
def test_areas_do_not_depend_on_the_frame(degrees: float) -> None:
    floor = rooms(np.random.default_rng(11))
    areas = []
    for angle, shift in ((0.0, 0.0), (degrees, 37.7)):
        moved = affinity.translate(affinity.rotate(floor, angle, origin=(0, 0)), shift, -shift)
        env = an.environment_from_shapes(shapely.get_parts(moved).tolist())
        xmin, ymin, xmax, ymax = env.bounds
        x, y = np.arange(xmin + 0.01, xmax, 0.02), np.arange(ymin + 0.01, ymax, 0.02)
        codes = judged_at(env, x, y)
        areas.append([np.count_nonzero(codes == k) * 0.02**2 for k in range(5)])
        areas[-1].append(float(reach_of(env, 0.2).floor.area))
    assert areas[1][:-1] == pytest.approx(areas[0][:-1], abs=0.005 * floor.area)
    assert areas[1][-1] == pytest.approx(areas[0][-1], rel=1e-3)
    assert areas[0][0] == pytest.approx(areas[0][-1], rel=0.005)


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))]
)
def test_a_changed_building_is_judged_as_a_new_one(seed: int) -> None:
    rng = np.random.default_rng(200 + seed)
    env = on_a_page() if seed == 0 else an.environment_from_shapes(
        shapely.get_parts(rooms(rng)).tolist(), name="rooms"
    )  # fmt: skip
    amap = an.build_map(env, LASER, spacing=0.2, store=False)
    for _ in range(4):
        inside = rng.permutation(np.argwhere(amap.judged.counted))[:3]
        places = [(float(amap.dataset["x"][c]), float(amap.dataset["y"][r])) for r, c in inside]
        posts = [Obstacle.post(x, y, float(rng.uniform(0.05, 0.4))) for x, y in places[:2]]
        x, y = places[2]
        after = env.edited(add=[*posts, Obstacle.wall([(x - 1.5, y), (x + 1.5, y)], 0.1)])
        found = amap.update(after).judged
        fresh = an.build_map(after, LASER, spacing=0.2, store=False).judged
        np.testing.assert_array_equal(found.code, fresh.code)
