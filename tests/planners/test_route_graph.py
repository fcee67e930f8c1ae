"""Route graphs: files, blocked edges, costs and routes against a search that shares no code."""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambinav import RangeScanner, build_map, environment_from_shapes
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners.fronts import pareto
from ambinav_planners.graph_pricing import JOIN_SLACK, JOIN_SPACING, PricedGraph
from ambinav_planners.missions import Mission, plan_mission
from ambinav_planners.planning import NotFoundError, RoutePlanner
from ambinav_planners.route_graph import RouteGraph
from ambinav_planners.search.limit import longest_bad
from ambinav_planners.search.reachability import NoPathError
from tests.planners.conftest import LASER

Edges = Sequence[tuple[int, int]]
# In the demo's hall: a ring of 20 m that is driven one way round.
XY = ((12.0, 19.0), (18.0, 19.0), (18.0, 23.0), (12.0, 23.0), (15.0, 23.0))
RING: Edges = ((0, 1), (1, 2), (2, 4), (4, 3), (3, 0))


def node(k: int, xy: Sequence[float], **more: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"id": k, "frame": "map", **more},
        "geometry": {"type": "Point", "coordinates": list(xy)},
    }


def edge(k: int, a: int, b: object, **more: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "properties": {"id": k, "startid": a, "endid": b, **more},
        "geometry": {"type": "MultiLineString", "coordinates": [[[0.0, 0.0], [1.0, 1.0]]]},
    }


def written(path: Path, features: list[Any]) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def graph_of(xy: Sequence[Sequence[float]], edges: Edges) -> RouteGraph:
    pairs = np.array(edges, dtype=np.int32).reshape(-1, 2)
    return RouteGraph.numbered("drawn", np.array(xy, dtype=np.float64), pairs)


def off_graph(edges: Edges, graph: RouteGraph, poses: Any) -> list[Any]:
    """Motions of a route, but for the first and the last, that follow no edge in its direction."""
    lines = [shapely.LineString(graph.xy[[a, b]]) for a, b in edges]
    away = []
    for a, b in itertools.pairwise(poses[1:-1, :2]):
        along = [
            line
            for line in lines
            if line.distance(shapely.Point(a)) < 1e-6
            and line.distance(shapely.Point(b)) < 1e-6
            and line.project(shapely.Point(a)) < line.project(shapely.Point(b))
        ]
        away += [] if along else [(a, b)]
    return away


def brute_force(
    robot: RoutePlanner, graph: RouteGraph, edges: Edges, start: Any, goal: Any
) -> float:
    """Cost of the cheapest path by Bellman and Ford."""

    def cost(a: Any, b: Any) -> float:
        return float(robot.service.motion_cost(*a[:2], *b[:2]))

    points, pieces = [*graph.xy], {}
    for i, j in edges:
        count = max(math.ceil(math.dist(graph.xy[i], graph.xy[j]) / JOIN_SPACING), 1)
        chain = [i, *range(len(points), len(points) + count - 1), j]
        points += [graph.xy[i] + (graph.xy[j] - graph.xy[i]) * k / count for k in range(1, count)]
        pieces.update({(u, v): cost(points[u], points[v]) for u, v in itertools.pairwise(chain)})
    used = sorted({node for pair in pieces for node in pair})
    there = np.array([[*points[u], 0.0] for u in used])
    ends = []
    for end in (start, goal):
        sees = robot.checker.motions_free(np.broadcast_to(end, there.shape), there)
        away = {
            u: math.dist(end[:2], points[u]) for u, seen in zip(used, sees, strict=True) if seen
        }
        nearest = min(away.values(), default=0.0)
        ends.append({u for u, metres in away.items() if metres <= nearest + JOIN_SLACK})
    best = {u: cost(start, points[u]) if u in ends[0] else math.inf for u in used}
    for _ in used:
        for (u, v), value in pieces.items():
            best[v] = min(best[v], best[u] + value)
    return min((best[u] + cost(points[u], goal) for u in ends[1]), default=math.inf)


@settings(max_examples=8)
@example(seed=679, share=0.1)  # no edge at all
@given(seed=st.integers(0, 10_000), share=st.sampled_from([0.1, 0.3, 0.6]))
def test_routes_are_those_of_brute_force(robot: RoutePlanner, seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    service, checker = robot.service, robot.checker
    places = np.column_stack([rng.uniform(1, 29, 80), rng.uniform(1, 21, 80), np.zeros(80)])
    *nodes, start, goal = places[checker.poses_free(places)][:10]
    edges = [pair for pair in itertools.permutations(range(8), 2) if rng.uniform() < share]
    graph = graph_of([xy[:2] for xy in nodes], edges)
    segments = shapely.linestrings(checker.geometry.segments.xy.reshape(-1, 2, 2))
    walls = shapely.multilinestrings(list(segments))
    free = [
        (a, b)
        for a, b in edges
        if shapely.LineString(graph.xy[[a, b]]).distance(walls) >= robot.checker.footprint.radius
    ]
    if not free:
        with pytest.raises(InputError, match=f"can drive none of its {len(edges)} edges"):
            RoutePlanner(service, route_graph=graph)
        return
    follower = RoutePlanner(service, route_graph=graph)
    priced = follower.priced_graph
    assert priced is not None
    assert [edges[k] for k in np.flatnonzero(priced.free)] == free
    best = brute_force(robot, graph, free, start, goal)
    costs = priced.costs_between([tuple(start), tuple(goal)], service.weight)
    assert costs[0, 1] == pytest.approx(best, rel=1e-6)
    if math.isinf(best):
        with pytest.raises((NotFoundError, NoPathError)):
            follower.plan(start, goal)
        return
    route = follower.plan(start, goal)
    assert checker.motions_free(route.poses[:-1], route.poses[1:]).all()
    assert off_graph(free, graph, route.poses) == []
    assert route.cost == pytest.approx(best, rel=1e-6)


@pytest.fixture(scope="module")
def ring(demo: AmbiguityService) -> RoutePlanner:
    return RoutePlanner(demo, route_graph=graph_of(XY, RING))


def test_a_one_way_ring_is_driven_in_its_direction(ring: RoutePlanner) -> None:
    ahead, back = ring.plan((14.0, 19.0), (16.0, 19.0)), ring.plan((16.0, 19.0), (14.0, 19.0))
    assert ahead.length == pytest.approx(2.0)
    assert back.length == pytest.approx(18.0)
    assert ahead.planner == "route-graph"


def test_missions_over_a_graph(ring: RoutePlanner) -> None:
    """Round a one-way ring the stops come in the order of the ring, whatever was given."""
    stops = ((12.0, 21.0), (18.0, 21.0), (17.0, 19.0))
    start, goal = (14.0, 19.0), (13.0, 19.0)
    visited = plan_mission(ring, Mission(start, (goal,), stops, any_order=True))
    assert visited.order == (2, 1, 0)
    assert visited.route.length == pytest.approx(19.0)
    in_order = plan_mission(ring, Mission(start, (goal,), stops))
    assert in_order.route.length == pytest.approx(19.0 + 2 * 20.0)


def test_limits_hold_on_a_graph(demo: AmbiguityService) -> None:
    """The edges through the offices are longer, and keep to fewer bad metres in a row."""
    xy = ((9.25, 13.0), (29.85, 13.0), (9.25, 10.7), (14.3, 10.5), (26.9, 10.3), (29.85, 10.3))
    edges = ((0, 1), (0, 2), (2, 3), (3, 4), (4, 5), (5, 1))
    graph = graph_of(xy, edges)
    free = RoutePlanner(demo, route_graph=graph).plan(xy[0], xy[1], weight=0.0)
    assert free.length == pytest.approx(20.6)
    limited = RoutePlanner(demo, route_graph=graph, max_bad_metres=8.0, bad_level=0.4)
    route = limited.plan(xy[0], xy[1], weight=0.0)
    assert route.length > free.length
    assert longest_bad(route.poses, demo, route.steering, 0.4) <= 8.0 + 1e-6
    assert longest_bad(free.poses, demo, route.steering, 0.4) > 8.0
    limited = RoutePlanner(demo, route_graph=graph, max_bad_metres=0.01, bad_level=0.0)
    with pytest.raises(NotFoundError, match=r"no route over its edges keeps to at most 0\.01 m"):
        limited.plan(xy[0], xy[1])


def test_a_file_comes_back(ring: RoutePlanner, tmp_path: Path) -> None:
    """What is written for Nav2 is read as the same graph, with what else stood in it."""
    operations = {"open_door": {"type": "OpenDoor"}}
    features = [node(7 + k, xy, operations=operations) for k, xy in enumerate(XY)]
    features += [
        edge(30 + k, 7 + a, 7 + b, metadata={"speed_limit": 40}, cost=1.0)
        for k, (a, b) in enumerate(RING)
    ]
    features.append(edge(90, 7, 9))  # through a wall, see below
    graph = RouteGraph.read(written(tmp_path / "g.geojson", features))
    assert graph.pairs[:5].tolist() == [list(pair) for pair in RING]
    follower = RoutePlanner(ring.service, route_graph=graph)
    priced = follower.priced_graph
    assert isinstance(priced, PricedGraph)
    priced.save(tmp_path / "p.geojson", 2.0)
    again = RouteGraph.read(tmp_path / "p.geojson")
    kept = np.flatnonzero(priced.free)
    np.testing.assert_array_equal(again.xy, graph.xy)
    np.testing.assert_array_equal(again.pairs, graph.pairs[kept])
    assert again.nodes == graph.nodes
    for k, properties in zip(kept, again.edges, strict=True):
        assert properties["id"] == graph.edges[k]["id"]
        metadata = dict(properties["metadata"])
        a, b = graph.xy[graph.pairs[k]]
        assert metadata.get("speed_limit") == graph.edges[k].get("metadata", {}).get("speed_limit")
        assert properties["cost"] == pytest.approx(
            ring.service.with_weight(2.0).motion_cost(*a, *b), abs=1e-3
        )
        assert metadata["penalty"] == pytest.approx(2.0 * metadata["exposure"], abs=1e-3)
        assert metadata["length"] == pytest.approx(math.dist(a, b), abs=1e-3)
        route = RoutePlanner(ring.service).plan(a, b, weight=0.0)
        if route.length == pytest.approx(math.dist(a, b)):
            assert metadata["corridor"] == pytest.approx(route.corridor_metres, abs=0.1)
            assert metadata["open"] == pytest.approx(route.open_metres, abs=0.1)


def test_vertices_of_lines_stay_where_they_are(tmp_path: Path) -> None:
    """They were moved to whole millimetres: off the floor, at exactly the robot's clearance."""
    lines = [[[0.00049, 0.2], [1.00051, 0.2]], [[1.00052, 0.2], [2.0, 0.20049]]]
    features = [
        {"type": "Feature", "properties": {}, "geometry": {"type": "LineString", "coordinates": xy}}
        for xy in lines
    ]
    graph = RouteGraph.read(written(tmp_path / "lines.geojson", features))
    assert graph.xy.tolist() == [[0.00049, 0.2], [1.00051, 0.2], [2.0, 0.20049]]


def test_lines_meet_at_common_vertices(tmp_path: Path) -> None:
    def line(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
        geometry = {"type": kind, "coordinates": coordinates}
        return {"type": "Feature", "properties": properties, "geometry": geometry}

    path = written(
        tmp_path / "lines.geojson",
        [
            line("LineString", [[0, 0], [4, 0, 1.5], [8, 0]]),
            line("MultiLineString", [[[4.0004, 0], [4, 3]]], oneway=True),
            line("Polygon", [[[0, 0], [1, 0], [1, 1], [0, 0]]]),
        ],
    )
    graph = RouteGraph.read(path)
    ends = {tuple(map(tuple, graph.xy[pair])) for pair in graph.pairs}
    a, b, c, d = (0.0, 0.0), (4.0, 0.0), (8.0, 0.0), (4.0, 3.0)
    assert ends == {(a, b), (b, a), (b, c), (c, b), (b, d)}


WALL = {
    "type": "Feature",
    "properties": {"kind": "wall"},
    "geometry": {"type": "LineString", "coordinates": [[0, 0], [1, 0]]},
}


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ([], "there is no edge in it"),
        ([node(1, (0, 0)), node(1, (1, 0))], r"features\[1\]: id is 1, as that of another"),
        ([node(-1, (0, 0))], r"features\[0\]: id is -1; give a whole number"),
        ([node(1, (0, math.nan))], "it holds NaN, which is not valid JSON"),
        ([node(1, (0, 0)), edge(2, 1, 5)], r"features\[1\]: endid is 5, and no Point has that id"),
        ([node(1, (0, 0)), edge(2, 1, "1")], r"features\[1\]: endid is '1'; give a whole number"),
        ([node(1, (0, 0)), edge(2, 1, 1, metadata=[1])], "metadata is \\[1\\]; give an object"),
        ([{"type": "Feature"}], r"features\[0\]: geometry is None"),
        ([WALL], r"features\[0\]: kind is wall: this is the plan of a building"),
        ([3], r"features\[0\]: geometry is None"),
    ],
)
def test_files_that_are_no_graphs(tmp_path: Path, features: list[Any], message: str) -> None:
    path = written(tmp_path / "g.geojson", features)
    with pytest.raises(InputError, match=message) as error:
        RouteGraph.read(path)
    assert str(error.value).startswith(str(path))


@pytest.mark.parametrize("text", ["{", "[]", '{"type": "FeatureCollection"}', "[" * 100_000])
def test_files_that_are_no_collections(tmp_path: Path, text: str) -> None:
    path = tmp_path / "g.geojson"
    path.write_text(text)
    with pytest.raises(InputError, match=r"g\.geojson: (this is not valid JSON|features is None)"):
        RouteGraph.read(path)


def test_what_does_not_lead_there_is_said(demo: AmbiguityService, ring: RoutePlanner) -> None:
    parts = graph_of((*XY[:2], *XY[2:4]), ((0, 1), (2, 3)))
    with pytest.raises(
        NotFoundError,
        match=r"leads to 1 of 4 nodes.*from node 2 at \(18, 19\) to node 3 at \(18, 23\), 4\.0 m",
    ):
        RoutePlanner(demo, route_graph=parts).plan((14.0, 19.0), (16.0, 23.0))
    with pytest.raises(NotFoundError, match=r"the goal \(28, 17\) sees no point of an edge"):
        ring.plan((14.0, 19.0), (28.0, 17.0))
    with pytest.raises(InputError, match="can drive none of its 1 edges"):
        RoutePlanner(demo, route_graph=graph_of(((90.0, 2.0), (95.0, 2.0)), ((0, 1),)))
    with pytest.raises(InputError, match="give r2"):
        RoutePlanner(demo, route_graph=graph_of(XY, RING), space="se2")
    with pytest.raises(InputError, match="leave it out"):
        ring.plan((14.0, 19.0), (16.0, 19.0), planner_name="reference")
    with pytest.raises(InputError, match="leave route_graph out"):
        pareto(ring, (14.0, 19.0), (16.0, 19.0))


@pytest.mark.parametrize(
    ("top", "advice"),
    [
        (3.4, r"add edges, such as from node 2 at \(2, 3\.4\) to node 4 at \(4, 3\.4\), 2\.0 m"),
        (2.0, r"from \(2\.4, 1\) to \(3\.6, 1\), 1\.2 m, and .* the way is blocked; add nodes"),
    ],
)
def test_the_edge_that_is_missing_can_be_driven(top: float, advice: str) -> None:
    """The nearest nodes are on both sides of a wall; the upper ones are above it, or are not."""
    floor = shapely.box(0.0, 0.0, 6.0, 4.0).difference(shapely.box(2.98, 0.0, 3.02, 2.8))
    scanner = RangeScanner.planar(sensor=LASER, beams=24, aperture=2.0 * math.pi)
    amap = build_map(environment_from_shapes([floor]), scanner, spacing=0.2)
    graph = graph_of(((2.4, 1.0), (2.0, top), (3.6, 1.0), (4.0, top)), ((0, 1), (3, 2)))
    robot = RoutePlanner(AmbiguityService(amap), footprint=0.15, route_graph=graph)
    with pytest.raises(NotFoundError, match=advice):
        robot.plan((2.4, 1.0), (3.6, 1.0))
