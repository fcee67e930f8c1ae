from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

import ambinav as an
from ambinav_envs.buildings.free_space import MARGIN
from ambinav_envs.buildings.geodesic import SIDES, STEPS
from tests.envs.buildings.scenes import RADIUS, centres, places_in, room, screen, two_rooms


def test_room_is_what_is_left_around_the_robot() -> None:
    places = places_in(screen())
    x, y = centres(places)
    environment = places.checker.environment
    inside = environment.is_free(x, y)
    assert ((places.room >= -RADIUS) == inside)[inside].all()
    assert (places.room[~inside] == -1.0).all()
    away = environment.clearance(x, y)
    near = inside & (away < 0.8)
    np.testing.assert_allclose(places.room[near], away[near] - RADIUS, atol=1e-6)
    assert (places.free == environment.is_free(x, y, RADIUS)).all()
    standing = np.zeros_like(inside).ravel()
    standing[places.standing] = True
    clear = environment.clearance(x, y).ravel()
    assert (clear[standing] >= RADIUS + MARGIN - 1e-6).all()
    assert not (inside.ravel() & ~standing & (clear > RADIUS + MARGIN + 1e-6)).any()


@pytest.mark.parametrize("radius", [0.1, RADIUS])
def test_moves_are_the_ways_that_the_robot_gets_along(radius: float) -> None:
    shape = shapely.affinity.rotate(shapely.box(2.0, 0.0, 2.3, 3.1), 20.0)
    environment = an.environment_from_shapes(
        [shapely.box(0, 0, 5, 4)], [shape], walls=[np.array([(3.5, 0.5), (4.4, 3.0)])]
    )
    places = places_in(environment, radius)
    x, y = (axis.ravel() for axis in centres(places))
    columns = places.room.shape[1]
    free, moves = places.free.ravel(), places.moves.ravel()
    links = places.links.ravel()
    for k, (dx, dy) in enumerate(STEPS):
        cells = np.flatnonzero(free)
        column, row = cells % columns + dx, cells // columns + dy
        there = (column >= 0) & (column < columns) & (row >= 0) & (row < places.room.shape[0])
        cells, other = cells[there], (row * columns + column)[there]
        fits = free[other]
        a = np.stack([x[cells], y[cells], np.zeros(len(cells))], axis=1)
        b = np.stack([x[other], y[other], np.zeros(len(cells))], axis=1)
        wanted = places.checker.motions_free(a, b)
        has = moves[cells] >> k & 1 == 1
        np.testing.assert_array_equal(has[fits], wanted[fits])
        # Into what is nearer to a wall a way leads where no wall is between.
        linked = links[cells] >> k & 1 == 1 if k < SIDES else np.zeros(len(cells), dtype=bool)
        np.testing.assert_array_equal(has[~fits], linked[~fits])


def test_labels_are_the_parts_of_the_floor() -> None:
    rooms = [shapely.box(0, 0, 3, 3), shapely.box(3.2, 0, 9, 3), shapely.box(0, 3.2, 1.4, 5)]
    rooms.append(shapely.box(2.9, 1.0, 3.3, 1.3))  # too narrow
    places = places_in(an.environment_from_shapes(rooms))
    columns = places.room.shape[1]
    free = places.free.ravel()
    source, target = [], []
    for k, (dx, dy) in enumerate(STEPS):
        here = np.flatnonzero(free & (places.moves.ravel() >> k & 1 == 1))
        both = free[here + dy * columns + dx]
        source.append(here[both])
        target.append((here + dy * columns + dx)[both])
    pair = np.concatenate(source), np.concatenate(target)
    graph = coo_array((np.ones(len(pair[0])), pair), (free.size,) * 2)
    _, parts = connected_components(graph, directed=False)
    labels = places.labels.ravel()
    assert (labels[~free] == -1).all()
    assert labels.max() == 2
    for label in range(3):
        assert len(np.unique(parts[labels == label])) == 1
    assert len(np.unique(parts[free])) == 3
    counts = np.bincount(labels[free])
    assert (np.diff(counts) < 0).all()


def test_a_door_joins_two_rooms() -> None:
    assert places_in(two_rooms(1.0)).labels.max() == 0
    assert places_in(two_rooms(0.3)).labels.max() == 1
    assert places_in(two_rooms(0.5), 0.1).labels.max() == 0


def test_no_room_for_the_robot() -> None:
    with pytest.raises(an.InputError, match=r"room has no room for a robot of 2 m of radius.*map"):
        places_in(room(3.0, 3.0), 2.0)


def test_a_small_robot_gets_a_finer_lattice() -> None:
    assert places_in(room()).spacing == 0.2
    assert places_in(room(), 0.1).spacing == pytest.approx(0.1 * np.sqrt(2))
    assert places_in(room(2, 2), 0.0).spacing == pytest.approx(0.05 * np.sqrt(2))
    assert places_in(room(), spacing=0.5).spacing == 0.5
