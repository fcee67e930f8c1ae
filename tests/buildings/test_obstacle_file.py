"""Files of obstacles: written and read again, and what is no obstacle."""

from __future__ import annotations

import json
import math
from typing import Any

import pytest

from ambinav.buildings.obstacle_file import DrawnObstacle, collection, obstacles_of
from ambinav.runtime.errors import InputError

DRAWN = (
    DrawnObstacle("post", ((1.0, 2.0),), radius=0.1),
    DrawnObstacle("panel", ((0.0, 0.0), (0.0, 1.5))),
    DrawnObstacle("wall", ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0)), thickness=0.1),
    DrawnObstacle("reflector", ((3.0, 1.0),), radius=0.05),
    DrawnObstacle("reflector", ((3.0, 2.0), (4.0, 2.0))),
    DrawnObstacle("post", ((1.0, 2.0),), radius=0.1, bottom=0.3, top=25.0),
    DrawnObstacle("wall", ((0.0, 0.0), (2.0, 0.0)), bottom=1.5),
)


def feature(kind: Any, geometry: Any, **properties: Any) -> Any:
    return {"type": "Feature", "properties": {"kind": kind, **properties}, "geometry": geometry}


def test_what_is_written_is_read_again() -> None:
    assert obstacles_of(json.loads(json.dumps(collection(DRAWN))), "drawn") == DRAWN


def test_obstacles_have_the_size_that_is_drawn() -> None:
    built = [one.obstacle for one in DRAWN]
    assert [one.reflective for one in built] == [False, False, False, True, True, False, False]
    assert [(one.bottom, one.top) for one in built[-3:]] == [(0.0, None), (0.3, 25.0), (1.5, None)]
    assert [one.outline.geom_type for one in built] == [
        "Polygon", "LineString", "Polygon", "Polygon", "LineString", "Polygon", "LineString",
    ]  # fmt: skip
    assert built[0].outline.area == pytest.approx(math.pi * 0.1**2, rel=0.03)
    assert built[2].outline.area == pytest.approx(0.1 * 3.0)  # a mitred corner
    assert built[4].outline.length == pytest.approx(1.0)


POINT = {"type": "Point", "coordinates": [1, 2]}
LINE = {"type": "LineString", "coordinates": [[0, 0], [1, 0]]}


@pytest.mark.parametrize(
    ("one", "words"),
    [
        (7, "not a Feature"),
        (feature("pillar", POINT), "'pillar'; give post"),
        (feature("post", LINE, radius=1), "draw it as a Point"),
        (feature("wall", POINT, radius=1), "draw it as a LineString"),
        (feature("reflector", {"type": "Polygon"}), "a Point or a LineString"),
        (feature("post", POINT), "radius is None"),
        (feature("post", POINT, radius=0.1, bottom=""), "bottom is ''; give 0 to 1000 metres"),
        (feature("post", POINT, radius=0.1, top=2000), "top is 2000; give 0 to 1000 metres"),
        (feature("post", POINT, radius=0.1, bottom=1, top=0.5), "top is 0.5 and bottom 1"),
        (feature("post", POINT, radius=0), "0.005 to 20"),
        (feature("post", POINT, radius=math.nan), "radius is nan"),
        (feature("post", POINT, radius=True), "radius is True"),
        (feature("post", {"type": "Point", "coordinates": [1]}, radius=1), r"\[1\] is not a point"),
        (feature("wall", LINE, thickness=-1), "thickness is -1"),
        (feature("post", POINT, radius=10**400), "radius is 1000"),
        (feature("wall", {"type": "LineString", "coordinates": [[0, 0]]}), "0 m long"),
        (feature("wall", {"type": "LineString", "coordinates": [[0, math.inf], [1, 1]]}), "inf"),
    ],
)
def test_what_is_no_obstacle_is_refused(one: Any, words: str) -> None:
    document = {"type": "FeatureCollection", "features": [DRAWN[0].feature, one]}
    with pytest.raises(InputError, match=words) as caught:
        obstacles_of(json.loads(json.dumps(document)), "drawn")
    assert "drawn: obstacle 2" in str(caught.value)


@pytest.mark.parametrize("document", [None, [1], {"type": "FeatureCollection"}])
def test_something_else_is_refused(document: Any) -> None:
    with pytest.raises(InputError, match=r"drawn: this is not a FeatureCollection"):
        obstacles_of(document, "drawn")
