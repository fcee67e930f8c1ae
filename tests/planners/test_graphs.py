"""Graphs of motions: searched against all paths, on the lattice, and as a grown roadmap."""

from __future__ import annotations

import gc
import itertools
import math
import weakref
from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

import ambinav as an
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.service.service import AmbiguityService
from ambinav_planners.planning import RoutePlanner
from ambinav_planners.registry import Budget
from ambinav_planners.roadmap import Roadmap, grown_graph
from ambinav_planners.search.alternatives import SLACK, alternative_paths
from ambinav_planners.search.corridor import GREED, corridor
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.search.lattice_graph import LatticeGraph, lattice_of
from ambinav_planners.search.lattice_motions import STEPS
from tests.planners.conftest import LASER
from tests.planners.small_graphs import graph_of, graphs, simple_paths

SIDE, SPACING = 6.0, 0.25
START, GOAL = (3.0, 3.0, 0.0), (12.0, 6.0, 1.0)


@pytest.fixture(scope="module")
def room() -> RoutePlanner:
    """A robot in an empty square."""
    environment = an.environment_from_shapes([shapely.box(0, 0, SIDE, SIDE)], name="room")
    scanner = an.RangeScanner.planar(sensor=LASER, beams=36, aperture=2.0 * math.pi)
    amap = an.build_map(environment, scanner, spacing=SPACING)
    return RoutePlanner(amap)


@pytest.fixture(scope="module")
def lattice(room: RoutePlanner) -> LatticeGraph:
    return LatticeGraph.build(room.service, room.checker)


def check_motions(graph: MotionGraph, robot: RoutePlanner) -> None:
    """Held by every graph: its motions are free and cost what the service says."""
    a, b = graph.poses[graph.source], graph.poses[graph.target]
    assert robot.checker.poses_free(graph.poses).all()
    assert robot.checker.motions_free(a, b).all()
    steering, service = graph.steering, robot.service
    np.testing.assert_allclose(graph.length, steering.lengths(a, b), rtol=1e-7)
    np.testing.assert_allclose(graph.exposure, service.motion_exposures(a, b, steering), rtol=1e-7)
    for weight in (0.0, 1.0, 5.0):
        costs = service.with_weight(weight).motion_costs(a, b, steering)
        np.testing.assert_allclose(graph.cost(weight), costs, rtol=1e-5)
    assert (graph.fixed >= graph.length * (1.0 - 1e-5)).all()


@settings(max_examples=60, deadline=None)
@given(graphs(), st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.7, 5.0]))
def test_the_cheapest_way_is_that_among_all(graph: MotionGraph, seed: int, weight: float) -> None:
    rng = np.random.default_rng(seed)
    graph = replace(graph, exposure=rng.uniform(0.0, 3.0, len(graph.length)))
    goal = len(graph.poses) - 1
    cost = graph.fixed + weight * graph.exposure
    np.testing.assert_allclose(graph.cost(weight), cost)
    nodes = graph.cheapest(0, goal, weight)
    assert nodes is not None
    assert (nodes[0], nodes[-1]) == (0, goal)
    table = graph.matrix(cost)
    got = sum(table[a, b] for a, b in itertools.pairwise(nodes))
    least = min(cost[path].sum() for path in simple_paths(graph, 0, goal))
    assert got == pytest.approx(least)


def test_a_matrix_holds_every_motion_where_it_belongs() -> None:
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 2.0, 0.0], [9.0, 9.0, 0.0]])
    graph = graph_of(poses, [(0, 1), (1, 2)])
    expected = np.zeros((4, 4))
    expected[0, 1] = expected[1, 0] = 1.0
    expected[1, 2] = expected[2, 1] = 2.0
    np.testing.assert_array_equal(graph.matrix(graph.length).toarray(), expected)
    assert graph.source.tolist() == [0, 1, 1, 2]
    assert graph.components().tolist() == [0, 0, 0, 1]
    assert graph.cheapest(0, 3, 1.0) is None
    assert graph.cheapest(2, 0, 1.0).tolist() == [2, 1, 0]  # type: ignore[union-attr]


def test_nodes_in_one_place_are_joined_for_nothing() -> None:
    graph = graph_of(np.zeros((2, 3)), [(0, 1)])
    assert graph.cheapest(0, 1, 5.0).tolist() == [0, 1]  # type: ignore[union-attr]


def test_the_lattice_has_sixteen_half_steps() -> None:
    assert len(STEPS) == 16
    both = np.concatenate([STEPS, -STEPS])
    assert len({tuple(step) for step in both.tolist()}) == 32
    angles = np.sort(np.arctan2(both[:, 1], both[:, 0]))
    widest = np.diff(angles, append=angles[0] + 2.0 * np.pi).max()
    assert 1.0 / math.cos(widest / 2.0) < 1.0131


def test_an_empty_room_as_a_lattice(room: RoutePlanner, lattice: LatticeGraph) -> None:
    x, y = np.meshgrid(*(room.service.map.dataset[axis].values for axis in "xy"))
    fits = (np.minimum(x, y) >= 0.2) & (np.maximum(x, y) <= SIDE - 0.2)
    np.testing.assert_array_equal(lattice.cell >= 0, fits)
    np.testing.assert_allclose(lattice.graph.poses[lattice.cell[fits]][:, 0], x[fits])
    check_motions(lattice.graph, room)
    rows, columns = (int(count) for count in (fits.any(1).sum(), fits.any(0).sum()))
    motions = sum((columns - abs(dx)) * (rows - abs(dy)) for dx, dy in STEPS.tolist())
    assert len(lattice.graph.length) == 2 * motions
    components = lattice.graph.components()
    labels = lattice.labels(components)
    assert set(labels[fits]) == {0}
    assert set(labels[~fits]) == {-1}


def test_ways_over_the_lattice_are_nearly_straight(lattice: LatticeGraph) -> None:
    graph = lattice.graph
    middle = len(graph.poses) // 2
    lengths = dijkstra(graph.matrix(graph.length), indices=middle)
    straight = np.hypot(*(graph.poses[:, :2] - graph.poses[middle, :2]).T)
    others = straight > 0.0
    ratio = lengths[others] / straight[others]
    assert ratio.min() >= 1.0 - 1e-7
    assert ratio.max() <= 1.0131


def test_ends_are_joined_to_what_they_see(room: RoutePlanner, lattice: LatticeGraph) -> None:
    ends = np.array([[0.31, 0.47, 0.0], [5.1, 5.77, 0.0]])
    graph = lattice.with_ends(ends, room.checker)
    cells = len(lattice.graph.poses)
    np.testing.assert_array_equal(graph.poses[cells:], ends)
    np.testing.assert_array_equal(graph.poses[:cells], lattice.graph.poses)
    check_motions(graph, room)
    assert len(set(graph.components())) == 1
    nodes = graph.cheapest(cells, cells + 1, 0.0)
    assert nodes is not None
    path = graph.poses[nodes]
    assert graph.steering.lengths(path[:-1], path[1:]).sum() == pytest.approx(
        math.dist(*ends[:, :2]), rel=0.0131
    )
    assert len(lattice.graph.poses) == cells  # as it was


@pytest.mark.slow(kept=("headings", "polygon"))
@pytest.mark.parametrize("kind", ["plain", "headings", "walls and no-go", "polygon"])
def test_every_free_motion_of_the_lattice_is_there(
    demo_map: AmbiguityMap, heading_map: AmbiguityMap, kind: str
) -> None:
    robot = {
        "plain": lambda: RoutePlanner(demo_map),
        "headings": lambda: RoutePlanner(heading_map),
        "walls and no-go": lambda: RoutePlanner(
            AmbiguityService(demo_map, clearance_weight=2.0), keep_out=shapely.box(4, 2, 6, 4)
        ),
        "polygon": lambda: RoutePlanner(
            demo_map,
            footprint=an.Footprint.polygon(
                [(-0.25, -0.15), (0.25, -0.15), (0.25, 0.15), (-0.25, 0.15)]
            ),
        ),
    }[kind]()
    lattice = LatticeGraph.build(robot.service, robot.checker)
    check_motions(lattice.graph, robot)
    cell = np.pad(lattice.cell, 3, constant_values=-1)
    pairs = []
    for column, row in STEPS:
        other = np.roll(cell, (-row, -column), axis=(0, 1))
        pairs.append(np.stack([cell, other], axis=-1)[(cell >= 0) & (other >= 0)])
    a, b = np.concatenate(pairs).T.astype(np.int64)
    poses = lattice.graph.poses
    free = robot.checker.motions_free(poses[a], poses[b])
    a, b = np.concatenate([a[free], b[free]]), np.concatenate([b[free], a[free]])
    source, target = lattice.graph.source.astype(np.int64), lattice.graph.target
    inner = np.maximum(source, target) < (lattice.cell >= 0).sum()
    got = np.sort(source[inner] * len(poses) + target[inner])
    np.testing.assert_array_equal(got, np.sort(a * len(poses) + b))


@pytest.mark.slow(kept=("headings",))
@pytest.mark.parametrize("kind", ["plain", "headings"])
def test_a_corridor_has_the_paths_of_the_lattice(
    demo_map: AmbiguityMap, heading_map: AmbiguityMap, kind: str
) -> None:
    robot = RoutePlanner(demo_map if kind == "plain" else heading_map)
    lattice, rng = lattice_of(robot.service, robot.checker), np.random.default_rng(0)
    poses = lattice.graph.poses
    for weight in (0.0, 5.0, 50.0):
        service = robot.service.with_weight(weight)
        for _ in range(4):
            ends = poses[rng.integers(len(poses), size=2)]
            reported: list[np.ndarray] = []
            found = corridor(lattice, service, robot.checker, ends, SLACK, reported.append)
            assert found is not None
            graph, least = found
            expected = alternative_paths(lattice.with_ends(ends, robot.checker), weight, 0.4)
            got = alternative_paths(graph, weight, 0.4)
            costs = [
                [service.route_cost(path, graph.steering) for path in paths]
                for paths in (got, expected)
            ]
            np.testing.assert_allclose(*costs, rtol=1e-6)
            first, cheapest = (service.route_cost(path, graph.steering) for path in reported)
            assert cheapest == pytest.approx(costs[0][0], rel=1e-6)
            assert least == pytest.approx(cheapest, rel=1e-6)
            assert cheapest <= first * (1.0 + 1e-6) <= GREED * cheapest * (1.0 + 1e-6)


def test_one_lattice_serves_every_weight(room: RoutePlanner) -> None:
    kept = lattice_of(room.service, room.checker)
    assert lattice_of(room.service.with_weight(9.0), room.checker) is kept
    again = RoutePlanner(room.service.map, footprint=room.checker.footprint.radius)
    assert lattice_of(again.service, again.checker) is kept  # and every robot of this size
    other = AmbiguityService(room.service.map, "major")
    assert lattice_of(other, room.checker) is not kept


@pytest.mark.slow
def test_a_lattice_goes_with_its_checker(room: RoutePlanner) -> None:
    robot = RoutePlanner(room.service, footprint=0.21)
    gone = weakref.ref(lattice_of(robot.service, robot.checker)), weakref.ref(robot.checker)
    del robot
    gc.collect()
    assert [each() for each in gone] == [None, None]


@pytest.mark.parametrize("space", ["r2", "se2", "dubins", "reeds-shepp"])
def test_a_roadmap_s_motions_are_free_and_measured(demo: AmbiguityService, space: str) -> None:
    robot = RoutePlanner(
        demo, space=space, turning_radius=0.4 if space in ("dubins", "reeds-shepp") else 0.0
    )
    roadmap = Roadmap.over(robot.problem(START, GOAL))
    roadmap.grow(300)
    assert 300 <= roadmap.milestones <= 302
    graph = roadmap.graph()
    assert len(graph.poses) == roadmap.milestones + 2
    np.testing.assert_array_equal(graph.poses[-2:], [START, GOAL])
    check_motions(graph, robot)
    there = set(zip(graph.source.tolist(), graph.target.tolist(), strict=True))
    assert len(there) == len(graph.length)  # none twice
    back = {(b, a) for a, b in there}
    if space in ("r2", "se2"):
        assert there == back
    elif space == "dubins":
        assert len(there & back) < len(there)
    roadmap.grow(400)
    assert len(roadmap.graph().poses) > len(graph.poses)


def test_on_a_map_with_headings_motions_of_r2_are_measured_each_way(
    heading_map: AmbiguityMap,
) -> None:
    robot = RoutePlanner(heading_map)
    graph = grown_graph(robot.problem(START, GOAL), Budget(iterations=200))
    check_motions(graph, robot)
    table = graph.matrix(graph.exposure)
    assert abs(table - table.T).max() > 0.01


def test_a_roadmap_serves_every_weight(robot: RoutePlanner) -> None:
    graph = grown_graph(robot.problem(START, GOAL), Budget(iterations=1000))
    start, goal = len(graph.poses) - 2, len(graph.poses) - 1
    paths = [graph.cheapest(start, goal, weight) for weight in (0.0, 5.0, 50.0)]
    costs = [
        [
            robot.service.with_weight(w).route_cost(graph.poses[path], graph.steering)
            for path in paths
        ]
        for w in (0.0, 5.0, 50.0)
    ]
    for k in range(3):
        assert costs[k][k] == min(costs[k])


def test_a_roadmap_stops_growing_in_time(robot: RoutePlanner) -> None:
    empty = grown_graph(robot.problem(START, GOAL), Budget(seconds=1e-9))
    assert len(empty.poses) == 2
    # A machine with other work to do gets more time for the first batch.
    for seconds in (0.2, 2.0, 20.0):
        count = len(grown_graph(robot.problem(START, GOAL), Budget(seconds=seconds)).poses)
        if count > 2:
            break
    assert 2 < count < 1_000_000
