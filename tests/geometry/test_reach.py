"""What a disc reaches: against doors of known width, and a flood fill that shares no code."""

from __future__ import annotations

import json
import math
import re
import warnings
from collections import deque

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, box

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.polygons import load_polygons
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.runtime.errors import InputError, InputWarning

CELL = 0.05


def two_rooms(door: float, *, thin: bool = False) -> Environment:
    """Rooms of 4 x 4 m and 3 x 4 m beside each other, and a door between them."""
    if thin:
        low, high = (4 - door) / 2, (4 + door) / 2
        walls = [LineString([(4, 0), (4, low)]), LineString([(4, high), (4, 4)])]
        return environment_from_shapes([box(0, 0, 7, 4)], walls=walls)
    rooms = [box(0, 0, 3.8, 4), box(4, 0, 7, 4)]
    return environment_from_shapes([*rooms, box(3.8, 2 - door / 2, 4, 2 + door / 2)])


@pytest.mark.parametrize("thin", [False, True])
@pytest.mark.parametrize(("door", "through"), [(0.398, False), (0.4, True), (0.402, True)])
def test_a_door_is_judged_by_its_width(door, through, thin):
    reach = find_reach(two_rooms(door, thin=thin), 0.2)
    assert reach.reaches(1.0, 2.0)
    assert reach.reaches(6.0, 2.0) == through
    assert reach.has_room(6.0, 2.0)
    # In the corner the centre stays a radius away.
    assert not reach.has_room(0.19, 1.0) and reach.has_room(0.21, 1.0)


def test_area_of_a_room_with_a_pillar():
    # Each side shrinks by r, the pillar grows by it, with round corners.
    environment = environment_from_shapes([box(0, 0, 6, 4)], obstacles=[box(2, 1, 3, 2)])
    reach = find_reach(environment, 0.3)
    grown = 1.0 + 4 * 0.3 + math.pi * 0.3**2
    assert reach.floor.area == pytest.approx(5.4 * 3.4 - grown, abs=2e-3)
    assert reach.notes == ()


def test_of_equal_pieces_the_order_of_drawing_chooses_none():
    rooms = [box(0, 0, 3, 2), box(5, 0, 8, 2)]
    for drawn in (rooms, rooms[::-1]):
        env = environment_from_shapes(drawn)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", InputWarning)
            assert find_reach(env, 0.2).floor.bounds[2] < 4.0


def test_a_start_chooses_the_piece():
    environment = two_rooms(0.3)
    assert find_reach(environment, 0.2).reaches(1.0, 2.0)
    reach = find_reach(environment, 0.2, (6.0, 2.0))
    assert reach.start == (6.0, 2.0)
    assert reach.reaches(5.0, 1.0) and not reach.reaches(1.0, 2.0)


@pytest.mark.parametrize(
    ("start", "why"),
    [
        ((3.9, 1.0), "in a wall"),
        ((0.05, 2.0), r"0\.05 m from a wall, the footprint needs 0\.2 m"),
        ((50.0, 2.0), "outside of the map"),
        ((3.9, 2.0), r"0\.15 m from a wall"),
    ],
)
def test_a_start_where_the_robot_does_not_fit(start, why):
    environment = two_rooms(0.3)
    with pytest.raises(InputError, match=why) as caught:
        find_reach(environment, 0.2, start)
    text = str(caught.value)
    assert text.count("; ") == 1 and text.endswith("m away.")
    found = re.search(r"is \((-?[\d.]+), (-?[\d.]+)\), ([\d.]+) m away", text)
    assert found is not None
    offered = float(found[1]), float(found[2])
    # What is offered can be typed, and nothing is much nearer.
    again = find_reach(environment, 0.2, offered)
    assert again.start == offered
    exact = again.fits.distance(shapely.Point(start))
    assert float(found[3]) == pytest.approx(exact, abs=0.03)


def test_odd_numbers_are_refused():
    environment = two_rooms(1.0)
    for radius in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(InputError, match=r"metres above 0|finite"):
            find_reach(environment, radius)
    with pytest.raises(InputError, match="two finite numbers"):
        find_reach(environment, 0.2, (math.nan, 1.0))
    with pytest.raises(InputError, match=r"fits nowhere, the widest place takes 1\.9 m") as caught:
        find_reach(environment, 2.5)
    assert "give a smaller robot radius" in str(caught.value)
    assert find_reach(environment, 1.9).reaches(1.9, 2.0)  # what is offered fits


# -- maps -----------------------------------------------------------------------------------


def page(width: int = 200, height: int = 160, margin: int = 30) -> np.ndarray:
    """A building of 10 cells thick walls in the middle of a white page, row 0 below."""
    state = np.full((height, width), FREE, dtype=np.uint8)
    state[margin : height - margin, margin : width - margin] = OCCUPIED
    inner = margin + 10
    state[inner : height - inner, inner : width - inner] = FREE
    return state


def grid(state: np.ndarray, **more: float) -> Environment:
    return environment_from_grid(OccupancyGrid(state, CELL, (3.0, -2.0, 0.3)), **more)


def at(environment: Environment, column: float, row: float) -> tuple[float, float]:
    """The place of a cell in the map frame."""
    assert environment.occupancy is not None
    x, y = environment.occupancy.to_world(column, row)
    return float(x), float(y)


def reached(environment: Environment, reach, column: float, row: float) -> bool:
    return bool(reach.reaches(*at(environment, column, row)))


@pytest.mark.slow
def test_the_margin_of_a_page_is_passed_over():
    environment = grid(page())
    with pytest.warns(InputWarning) as caught:
        reach = find_reach(environment, 0.2)
    first, second = (str(note.message) for note in caught)
    # All around: 2 x (10 + 8) m, a wall's thickness off the corners at most.
    assert re.search(r"touches the rim of the map along 36\.0 m", first)
    assert "as the margin of a page does" in second and "--start X Y" in second
    assert reach.notes == (first, second)
    assert reached(environment, reach, 100, 80)
    assert not reached(environment, reach, 10, 80)
    # The margin is there for whoever asks for it.
    with pytest.warns(InputWarning):
        outside = find_reach(environment, 0.2, at(environment, 10, 80))
    assert reached(environment, outside, 190, 150)
    assert not reached(environment, outside, 100, 80)


def test_floor_that_the_map_cuts_off_is_no_margin():
    # A hall that reaches the rim along a fifth of it, and a closed closet: the hall counts.
    state = np.full((100, 100), OCCUPIED, dtype=np.uint8)
    state[10:100, 5:85] = FREE
    state[40:60, 90:98] = FREE
    environment = grid(state)
    with pytest.warns(InputWarning, match=r"touches the rim of the map along [34]\.\d m"):
        reach = find_reach(environment, 0.15)
    assert len(reach.notes) == 1
    assert reached(environment, reach, 50, 50)


def test_streets_are_not_left_out_for_a_backyard():
    # Floor all along the rim, but the only other piece is a backyard.
    state = np.full((200, 200), FREE, dtype=np.uint8)
    state[80:110, 80:110] = OCCUPIED
    state[85:105, 85:105] = FREE
    environment = grid(state)
    with pytest.warns(InputWarning, match="touches the rim"):
        reach = find_reach(environment, 0.2)
    assert len(reach.notes) == 1
    assert reached(environment, reach, 20, 20) and not reached(environment, reach, 95, 95)


def test_crates_hollow_walls_and_pillars():
    state = np.full((140, 240), OCCUPIED, dtype=np.uint8)
    state[4:136, 4:236] = FREE
    state[30:60, 30:60] = OCCUPIED  # a crate, its inside free
    state[33:57, 33:57] = FREE
    state[4:136, 118:136] = OCCUPIED  # a wall of two leaves, hollow, with a door
    state[8:132, 121:133] = FREE
    state[90:120, 118:136] = OCCUPIED
    state[93:117, 118:136] = FREE
    state[70:76, 180:186] = OCCUPIED  # a pillar
    environment = grid(state)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        reach = find_reach(environment, 0.2)
    assert reached(environment, reach, 15, 15)
    assert reached(environment, reach, 200, 30)  # through the door
    assert not reached(environment, reach, 45, 45)  # in the crate
    assert not reached(environment, reach, 127, 40)  # in the wall
    assert not reached(environment, reach, 127, 128)
    assert not reached(environment, reach, 183, 68)  # beside the pillar
    assert reached(environment, reach, 183, 62)


def test_without_a_room_the_box_of_a_plan_is_its_rim(tmp_path):
    ring = [[2, 2], [8, 2], [8, 6], [2, 6], [2, 2]]
    path = tmp_path / "walls.geojson"
    feature = {"type": "LineString", "coordinates": ring}
    path.write_text(json.dumps({**feature, "bbox": [0, 0, 10, 8]}))
    environment = load_polygons(path)
    with pytest.warns(InputWarning) as caught:
        reach = find_reach(environment, 0.2)
    assert re.search(r"walls\.geojson: .* along 36\.0 m", str(caught[0].message))
    assert "along 100 % of the map's rim" in str(caught[1].message)
    assert reach.reaches(5.0, 4.0) and not reach.reaches(1.0, 1.0)


def test_turning_and_shifting_change_nothing():
    environment = grid(page())
    turned = environment.transformed(0.7, 100.0, -40.0)
    c, s = math.cos(0.7), math.sin(0.7)
    with pytest.warns(InputWarning):
        one, other = find_reach(environment, 0.2), find_reach(turned, 0.2)
    assert one.floor.area == pytest.approx(other.floor.area)
    assert len(one.notes) == len(other.notes) == 2
    x, y = at(environment, 60, 60)
    assert other.reaches(c * x - s * y + 100.0, s * x + c * y - 40.0)
    assert turned.occupancy is not None
    np.testing.assert_allclose(at(turned, 60, 60), (c * x - s * y + 100.0, s * x + c * y - 40.0))


def test_a_grid_tells_its_cells_by_place():
    state = page()
    state[0, 0] = UNKNOWN
    occupancy = OccupancyGrid(state, CELL, (3.0, -2.0, 0.3))
    rows, columns = np.indices(state.shape)
    x, y = occupancy.to_world(columns + 0.5, rows + 0.5)
    np.testing.assert_array_equal(occupancy.state_at(x, y), state)
    assert occupancy.state_at(-100.0, 0.0) == UNKNOWN
    assert shapely.Polygon(occupancy.outline()).area == pytest.approx(state.size * CELL**2)


# -- against a flood fill -------------------------------------------------------------------


@st.composite
def buildings(draw) -> tuple[Environment, float]:
    """A room with blocks and thin walls strewn over it, and a robot's radius."""
    count = draw(st.integers(1, 5))
    number = st.integers(0, 60)

    def place() -> tuple[float, float]:
        return draw(number) / 10, draw(number) / 10

    blocks, walls = [], []
    for _ in range(count):
        (x0, y0), (x1, y1) = place(), place()
        if abs(x1 - x0) > 0.05 and abs(y1 - y0) > 0.05 and draw(st.booleans()):
            thin = draw(st.booleans())
            x1 = x0 + (0.1 if thin else 0.4)
            blocks.append(box(min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))
        elif (x0, y0) != (x1, y1):
            walls.append(LineString([(x0, y0), (x1, y1)]))
    radius = draw(st.sampled_from([0.11, 0.17, 0.23, 0.31]))
    return environment_from_shapes([box(0, 0, 6, 6)], obstacles=blocks, walls=walls), radius


def flooded(
    environment: Environment, radius: float, start: tuple[int, int], step: float, size: int
) -> np.ndarray:
    """Points of a lattice that motions between neighbours reach, checked by the sweep kernels."""
    checker = CollisionChecker(environment, Footprint.disc(radius), Steering("r2"))
    xy = (np.indices((size, size)).reshape(2, -1).T + 0.5) * step
    index = np.arange(size * size).reshape(size, size)
    poses = np.column_stack([xy, np.zeros(len(xy))])
    free = checker.poses_free(poses)
    linked: dict[int, list[int]] = {}
    for a, b in ((index[1:], index[:-1]), (index[:, 1:], index[:, :-1])):
        a, b = a.ravel(), b.ravel()
        both = free[a] & free[b]
        a, b = a[both], b[both]
        is_free = checker.motions_free(poses[a], poses[b])
        for i, j in zip(a[is_free].tolist(), b[is_free].tolist(), strict=True):
            linked.setdefault(i, []).append(j)
            linked.setdefault(j, []).append(i)
    seen = {int(index[start])}
    queue = deque(seen)
    while queue:
        for near in linked.get(queue.popleft(), ()):
            if near not in seen:
                seen.add(near)
                queue.append(near)
    found = np.zeros(size * size, dtype=bool)
    found[list(seen)] = True
    return found


@pytest.mark.sweep
@settings(max_examples=25, deadline=None)
@given(buildings(), st.data())
def test_against_a_flood_fill_on_a_fine_lattice(building, data):
    environment, radius = building
    step, size = 0.04, 150
    reach = find_reach(environment, radius)
    xy = (np.indices((size, size)).reshape(2, -1).T + 0.5) * step
    inside = np.flatnonzero(
        np.asarray(environment.is_free(xy[:, 0], xy[:, 1], radius))
        & shapely.contains_xy(reach.floor, *xy.T)
    )
    if not inside.size:
        return
    chosen = int(inside[data.draw(st.integers(0, inside.size - 1))])
    start = (chosen // size, chosen % size)
    # What motions reach, the polygon holds.
    found = flooded(environment, radius, start, step, size)
    assert shapely.contains_xy(reach.floor.buffer(1e-3), *xy[found].T).all()
    # What a robot a little larger could reach in one piece, motions on the lattice reach.
    larger = shapely.get_parts(reach.floor.buffer(-step)).tolist()
    own = [part for part in larger if part.contains(shapely.Point(xy[chosen]))]
    for part in own:
        assert found[shapely.contains_xy(part, *xy.T)].all()


@pytest.mark.slow
def test_round_corners_are_as_near_as_is_said() -> None:
    # Chords are longest around a corner that turns by one and a half of them.
    turns = np.radians(np.linspace(1.0, 170.0, 340))
    nearest = 1.0
    for turn in turns.tolist():
        roof = [(0.0, 2.0), (-2.0, 2.0 - 2.0 * math.tan(0.5 * min(turn, 1.5)))]
        stand = shapely.Polygon([*roof, (-2.0, -3.0), (2.0, -3.0), (2.0, roof[1][1])])
        reach = find_reach(environment_from_shapes([shapely.box(-5, -5, 5, 5)], [stand]), 0.5)
        nearest = min(nearest, float(reach.fits.distance(stand)) / 0.5)
    assert 1.0 - 0.0028 < nearest < 1.0 - 0.0012
