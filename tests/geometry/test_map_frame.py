"""GeoJSON that we write says that it is metres of the map frame, to GDAL and to ourselves."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.obstacle_file import collection
from ambinav.buildings.plan_writer import plan_geojson
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav_planners.route_graph import RouteGraph


@pytest.fixture
def documents() -> list[dict[str, Any]]:
    room = an.environment_from_shapes([shapely.box(0, 0, 4, 3)])
    points = np.array([[1.0, 1.0], [2.0, 1.0]])
    graph = RouteGraph.numbered("g", points, np.array([[0, 1]])).text(5.0)
    return [plan_geojson(room), collection([]), json.loads(graph)]


def test_gdal_takes_it_for_a_local_system_in_metres(documents: list[dict[str, Any]]) -> None:
    crs = pytest.importorskip("rasterio.crs")
    for document in documents:
        assert MAP_FRAME.items() <= document.items()
    system = crs.CRS.from_user_input(MAP_FRAME["crs"]["properties"]["name"])
    assert system.to_wkt().startswith("LOCAL_CS[") and 'UNIT["metre",1]' in system.to_wkt()


def test_our_reader_does_not_warn_of_our_own_plan(
    documents: list[dict[str, Any]], tmp_path: Path
) -> None:
    (tmp_path / "plan.geojson").write_text(json.dumps(documents[0]))
    with warnings.catch_warnings(action="error"):
        again = an.load_environment(tmp_path / "plan.geojson")
    assert again.free.area == pytest.approx(12.0)
