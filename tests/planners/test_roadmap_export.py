"""The Route Server's graph, read as its loader reads it, against the walls."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav import AmbiguityMap
from ambinav.export.formats.exporting import export_map
from ambinav.export.options import ExportOptions
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.service.service import AmbiguityService

RADIUS = 0.25


def loaded(path: Path) -> tuple[dict[int, list[float]], dict[int, dict[str, Any]]]:
    """Nodes and edges by id, as geojson_graph_file_loader.cpp takes them."""
    nodes, edges = {}, {}
    for feature in json.loads(path.read_text())["features"]:
        properties, geometry = feature["properties"], feature["geometry"]
        # An unsigned int, and of its own for every node and edge.
        assert isinstance(properties["id"], int)
        assert properties["id"] > 0
        assert properties["id"] not in nodes
        assert properties["id"] not in edges
        if geometry["type"] == "Point":
            assert properties["frame"] == "map"
            nodes[properties["id"]] = geometry["coordinates"]
            continue
        assert geometry["type"] == "MultiLineString"
        edges[properties["id"]] = properties | {"line": geometry["coordinates"][0]}
    assert all({edge["startid"], edge["endid"]} <= set(nodes) for edge in edges.values())
    return nodes, edges


@pytest.fixture(scope="module")
def graph(
    demo_map: AmbiguityMap, tmp_path_factory: pytest.TempPathFactory
) -> tuple[dict[int, list[float]], dict[int, dict[str, Any]]]:
    options = ExportOptions(milestones=150, robot_radius=RADIUS, weight=3.0, seed=1)
    path = tmp_path_factory.mktemp("graph") / "g.geojson"
    with pytest.warns(InputWarning, match="left out"):
        return loaded(export_map(demo_map, "nav2-route-graph", path, options)[0])


def test_edges_join_their_nodes_and_keep_off_the_walls(graph: Any, demo_map: AmbiguityMap) -> None:
    nodes, edges = graph
    lines = [shapely.LineString(edge["line"]) for edge in edges.values()]
    for edge in edges.values():
        assert edge["line"] == [nodes[edge["startid"]], nodes[edge["endid"]]]
    floor = demo_map.environment.collision.free
    shapely.prepare(floor)
    assert shapely.contains_properly(floor, lines).all()
    walls = shapely.multilinestrings(
        list(shapely.linestrings(demo_map.segments.xy.reshape(-1, 2, 2)))
    )
    assert shapely.distance(lines, walls).min() > RADIUS - 0.001


def test_it_is_connected_and_every_edge_has_one_back(graph: Any) -> None:
    nodes, edges = graph
    there = {(edge["startid"], edge["endid"]): edge["cost"] for edge in edges.values()}
    assert len(there) == len(edges)
    assert all(there[b, a] == cost for (a, b), cost in there.items())
    reached, todo = {1}, [1]
    beside: dict[int, list[int]] = {}
    for a, b in there:
        beside.setdefault(a, []).append(b)
    while todo:
        for other in beside[todo.pop()]:
            if other not in reached:
                reached.add(other)
                todo.append(other)
    assert reached == set(nodes)
    assert len(nodes) > 100


def test_costs_are_those_of_the_service(graph: Any, demo_map: AmbiguityMap) -> None:
    _, edges = graph
    service = AmbiguityService(demo_map, weight=3.0)
    for edge in list(edges.values())[::40]:
        metadata = edge["metadata"]
        (x0, y0), (x1, y1) = edge["line"]
        theta = float(np.arctan2(y1 - y0, x1 - x0))
        cost = service.motion_cost(x0, y0, x1, y1, theta, theta)
        assert edge["cost"] == pytest.approx(cost, rel=2e-3)
        assert metadata["length"] == pytest.approx(np.hypot(x1 - x0, y1 - y0), abs=1e-3)
        assert edge["cost"] == pytest.approx(metadata["length"] + metadata["penalty"], abs=2e-4)
        assert metadata["penalty"] == pytest.approx(3.0 * metadata["exposure"], abs=1e-3)
        assert edge["overridable"] is False
        assert all(isinstance(value, float) for value in metadata.values())


def test_a_seed_gives_the_same_graph_and_parts_left_out_are_said(
    demo_map: AmbiguityMap, tmp_path: Path
) -> None:
    options = ExportOptions(milestones=60, seed=4)
    written = []
    for name in ("a.geojson", "b.geojson"):
        with pytest.warns(InputWarning, match=r"of 60 milestones are not connected .* left out"):
            written += export_map(demo_map, "nav2-route-graph", tmp_path / name, options)
    assert written[0].read_bytes() == written[1].read_bytes()


def test_a_robot_that_fits_nowhere(demo_map: AmbiguityMap, tmp_path: Path) -> None:
    options = ExportOptions(robot_radius=30.0)
    with pytest.raises(InputError, match="--robot-radius: 30 m: the robot fits at none"):
        export_map(demo_map, "nav2-route-graph", tmp_path / "g.geojson", options)
    assert list(tmp_path.iterdir()) == []


def test_without_ompl(
    demo_map: AmbiguityMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ambinav_planners.roadmap_export.has_ompl", lambda: False)
    with pytest.raises(InputError, match=r'pip install "ambinav\[planners\]"'):
        export_map(demo_map, "nav2-route-graph", tmp_path / "g.geojson")
