"""`ambinav plan` over route graphs, one-way lanes and preferred floor."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from ambinav.cli import app
from ambinav.routes.files import load_route
from ambinav_planners import RouteGraph

ENDS = ("--start", "1", "1", "--goal", "10", "2")


def collection(path: Path, *features: tuple[str, Any, dict[str, Any]]) -> None:
    plain = [
        {"type": "Feature", "geometry": {"type": kind, "coordinates": where}, "properties": more}
        for kind, where, more in features
    ]
    path.write_text(json.dumps({"type": "FeatureCollection", "features": plain}))


def test_a_route_over_a_graph(plan_folder: Path) -> None:
    """One line leads there; another one crosses walls, and is left out of what is written."""
    route = CliRunner().invoke(app, ["plan", "map.zarr", *ENDS, "-o", "free.csv", "-w", "0"])
    assert route.exit_code == 0, route.output
    points = load_route(plan_folder / "free.csv").poses[:, :2].tolist()
    collection(
        plan_folder / "g.geojson",
        ("LineString", points, {"oneway": True}),
        ("LineString", [points[0], [4.0, -5.0]], {}),
    )
    arguments = ["plan", "map.zarr", *ENDS, "--from-graph", "g.geojson", "-o", "r.csv"]
    result = CliRunner().invoke(app, [*arguments, "--priced-graph", "p.geojson", "--json"])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    edges = len(points) - 1
    assert document["graph"] == {"edges": edges + 2, "blocked": 2, "output": "p.geojson"}
    assert document["routes"]["weight 5"]["planner"] == "route-graph"
    assert len(RouteGraph.read(plan_folder / "p.geojson").edges) == edges
    result = CliRunner().invoke(app, arguments)
    assert f"graph: 2 of {edges + 2} edges are blocked for this robot and left out" in result.stdout
    back = CliRunner().invoke(
        app, [*arguments[:2], "--start", "10", "2", "--goal", "1", "1", *arguments[-4:]]
    )
    assert back.exit_code == 2
    assert (
        "g.geojson: only against the direction of some edges do they lead from the start"
        in back.stderr
    )


def test_lanes_and_preferred_floor(plan_folder: Path) -> None:
    (plan_folder / "p.wkt").write_text("POLYGON ((0 0, 2 0, 2 2, 0 2, 0 0))")
    box = [[[0, -50], [50, -50], [50, 50], [0, 50], [0, -50]]]
    costs = {}
    for name, angle, more in (
        ("east", 0.0, ()),
        ("west", 180.0, ()),
        ("outside", 0.0, ("--prefer", "p.wkt")),
    ):
        collection(plan_folder / "l.geojson", ("Polygon", box, {"direction": angle}))
        result = CliRunner().invoke(
            app, ["plan", "map.zarr", *ENDS, "--one-way", "l.geojson", *more, "-o", f"{name}.csv"]
        )
        assert result.exit_code == (2 if name == "west" else 0), result.output
        if name == "west":
            assert "no path that goes against no one-way lane" in result.stderr
        else:
            costs[name] = load_route(plan_folder / f"{name}.csv")
    outside = costs["outside"].cost - costs["east"].cost
    assert 0.5 * costs["east"].length < outside < costs["east"].length
    assert costs["east"].cost == pytest.approx(
        costs["east"].length + 5.0 * costs["east"].exposure, rel=1e-4
    )
