from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import ambinav as an
from ambinav_envs.buildings.free_space import FreeSpaceLattice
from ambinav_envs.buildings.geodesic import LENGTHS, STEPS, geodesic
from tests.envs.buildings.scenes import (
    RADIUS,
    centres,
    field_to,
    places_in,
    room,
    screen,
    two_rooms,
)


def from_cell(
    places: FreeSpaceLattice, cell: int, prices: NDArray[np.float32] | None = None
) -> NDArray[np.float32]:
    field = np.empty(places.room.shape, dtype=np.float32)
    prices = places.table.prices if prices is None else prices
    seeds = np.array([cell]), np.zeros(1)
    geodesic(*seeds, places.moves, places.links, prices, places.spacing, field)
    return field


def slow(
    places: FreeSpaceLattice, cell: int, prices: NDArray[np.float32] | None = None
) -> NDArray[np.float64]:
    """SciPy's costs of the paths to a cell over the same graph, shape (rows, columns)."""
    rows, columns = places.room.shape
    prices = places.table.prices if prices is None else prices
    each = prices.astype(np.float64).reshape(rows * columns, -1)
    source, target, length = [], [], []
    for k, (dx, dy) in enumerate(STEPS):
        here = np.flatnonzero(places.moves.ravel() >> k & 1)
        there = here + dy * columns + dx
        # From there to here it drives in this direction, of as many as there are prices.
        count = each.shape[1]
        h = math.floor(math.atan2(-dy, -dx) / (2.0 * math.pi) * count + 0.5) % count
        source.append(here)
        target.append(there)
        length.append(LENGTHS[k] * places.spacing * 0.5 * (each[here, h] + each[there, h]))
    graph = coo_array(
        (np.concatenate(length), (np.concatenate(source), np.concatenate(target))),
        (rows * columns,) * 2,
    )
    return np.asarray(dijkstra(graph.tocsr(), indices=cell)).reshape(rows, columns)


def cluttered(seed: int) -> an.Environment:
    rng = np.random.default_rng(seed)
    boxes = [
        shapely.affinity.rotate(shapely.box(x, y, x + w, y + d), angle)
        for x, y, w, d, angle in rng.uniform(0.3, [7, 6, 2, 2, 90], (7, 5))
    ]
    return an.environment_from_shapes([shapely.box(0, 0, 8, 7)], boxes, name="cluttered")


@pytest.mark.parametrize("seed", range(4))
def test_equals_dijkstra(seed: int) -> None:
    places = places_in(cluttered(seed))
    for cell in places.standing[:: len(places.standing) // 3]:
        field = from_cell(places, int(cell))
        wanted = slow(places, int(cell))
        known = np.isfinite(wanted)
        np.testing.assert_allclose(field[known], wanted[known], rtol=2e-6)
        # Where no path leads to there may be a distance too: as the lattice is linked.
        linked = (places.links > 0) & ~known
        assert (field[linked] > 0.0).all()


@pytest.mark.parametrize("headings", [1, 6, 16])
def test_the_cheapest_way_is_dijkstras(headings: int) -> None:
    places = places_in(cluttered(2))
    rng = np.random.default_rng(headings)
    # Prices as rough as they can be, up to the highest that there is.
    shape = (*places.room.shape, headings)
    prices = (1.0 + 100.0 * rng.uniform(size=shape) ** 4).astype(np.float32)
    for cell in places.standing[:: len(places.standing) // 3]:
        field = from_cell(places, int(cell), prices)
        wanted = slow(places, int(cell), prices)
        known = np.isfinite(wanted)
        np.testing.assert_allclose(field[known], wanted[known], rtol=1e-5)


def test_straight_in_an_empty_room() -> None:
    places = places_in(room())
    x, y = (axis[places.free] for axis in centres(places))
    for goal in ((1.0, 1.0), (3.17, 2.64), (7.5, 5.5)):
        field = field_to(places, *goal)
        straight = np.hypot(x - goal[0], y - goal[1])
        away = straight > 0.0
        ratio = field[places.free][away] / straight[away]
        assert ratio.min() >= 1.0 - 1e-6
        # Of 16 directions the widest angle is that of (1, 0) and (2, 1).
        assert ratio.max() <= 1.0 / math.cos(0.5 * math.atan2(1, 2)) + 1e-6
        assert ratio.mean() <= 1.015


def test_round_the_end_of_a_wall() -> None:
    places = places_in(screen())
    field = field_to(places, 1.0, 1.0)
    # Two tangents to the circle about the wall's end at (4, 4), and the arc between them.
    away = math.hypot(3.0, 3.0)
    arc = RADIUS * (1.5 * math.pi - 2.0 * math.acos(RADIUS / away))
    shortest = 2.0 * math.sqrt(away**2 - RADIUS**2) + arc
    found = places.distance(field, 7.0, 1.0)
    assert shortest * 0.999 <= found <= shortest * 1.04


def test_it_is_as_far_back() -> None:
    places = places_in(cluttered(1))
    a, b = places.standing[3], places.standing[-7]
    there, back = (from_cell(places, int(cell)) for cell in (a, b))
    assert there.ravel()[b] == pytest.approx(back.ravel()[a], rel=1e-6)


def test_distance_is_the_cells_own_and_linear_between() -> None:
    places = places_in(room())
    field = field_to(places, 1.0, 1.0)
    x, y = centres(places)
    r, c = 12, 20
    assert places.distance(field, x[r, c], y[r, c]) == pytest.approx(field[r, c])
    halfway = places.distance(field, x[r, c] + 0.1, y[r, c])
    assert halfway == pytest.approx(0.5 * (field[r, c] + field[r, c + 1]))
    corner = places.distance(field, x[r, c] + 0.05, y[r, c] + 0.15)
    weights = np.array([[0.75 * 0.25, 0.25 * 0.25], [0.75 * 0.75, 0.25 * 0.75]])
    assert corner == pytest.approx((weights * field[r : r + 2, c : c + 2]).sum())


@settings(max_examples=200, deadline=None)
@given(x=st.floats(0.22, 7.78), y=st.floats(0.22, 5.78))
def test_everywhere_the_robot_fits_there_is_a_distance(x: float, y: float) -> None:
    places = SCREEN
    if not places.checker.environment.is_free(x, y, 0.22):
        return
    found = places.distance(SCREEN_FIELD, x, y)
    assert math.isfinite(found)
    # The wall parts what is near in a straight line: beside it there are two worlds.
    behind = x > 4.0 and y < 3.0
    straight = math.hypot(x - 3.0, y - 1.0)
    if behind:
        assert found > 3.0 + straight / 2
    else:
        assert found >= straight - 0.1


SCREEN = places_in(screen())
SCREEN_FIELD = field_to(SCREEN, 3.0, 1.0)


def test_a_wall_without_thickness_is_not_read_across() -> None:
    for offset in np.linspace(0.22, 0.6, 14):
        left = SCREEN.distance(SCREEN_FIELD, 4.0 - offset, 1.0)
        right = SCREEN.distance(SCREEN_FIELD, 4.0 + offset, 1.0)
        assert left == pytest.approx(1.0 - offset, abs=0.1)
        assert right > 6.0


def test_beyond_a_gap_that_is_too_narrow_there_is_a_distance_nonetheless() -> None:
    # The robot gets through this door, but not along any line of the lattice.
    door = shapely.box(3.9, 1.77, 4.3, 2.23)
    rooms = [shapely.box(0, 0, 4, 4), shapely.box(4.2, 0, 8.2, 4), door]
    places = places_in(an.environment_from_shapes(rooms))
    ends = np.array([[3.5, 2.0, 0.0], [4.7, 2.0, 0.0]])
    assert places.checker.motions_free(ends[:1], ends[1:])[0]
    assert places.labels.max() == 1
    field = field_to(places, 1.0, 2.0)
    assert places.distance(field, 7.0, 2.0) == pytest.approx(6.0, rel=0.05)


def test_nothing_leads_through_a_wall_or_out_of_the_map() -> None:
    places = places_in(two_rooms(0.0))
    field = field_to(places, 1.0, 2.0)
    assert places.distance(field, 7.0, 2.0) == math.inf
    for x, y in ((-5.0, 2.0), (1.0, 40.0), (math.nan, 1.0), (math.inf, 1.0)):
        assert places.distance(field, x, y) == math.inf
