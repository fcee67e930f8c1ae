"""What the service tells of maps and of single poses, against the maps themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.maps.zones import ZONES
from tests.server.live import Live


def test_the_maps_are_listed_with_their_layers(live: Live, corridor: an.AmbiguityMap) -> None:
    first, second = live.get("/v1/maps")["maps"]
    assert (first["id"], second["id"]) == ("map", "narrow-room")
    assert (first["headings"], second["headings"]) == (None, 4)
    assert first["bounds"] == list(corridor.bounds)
    assert first["shape"] == list(corridor.dataset["free"].shape)
    assert first["radius"] == 0.5
    assert [one["name"] for one in first["layers"]] == list(corridor.layers)
    level = next(one for one in second["layers"] if one["name"] == "level")
    assert (level["units"], level["worse"], level["kind"], level["has_theta"]) == (
        "1", "high", "share", True,
    )  # fmt: skip


def test_a_map_in_full_tells_zones_parameters_and_figures(
    live: Live, corridor: an.AmbiguityMap
) -> None:
    found = live.get("/v1/maps/map")
    assert [zone["zone"] for zone in found["zones"]] == list(ZONES)
    assert sum(zone["share"] for zone in found["zones"]) == pytest.approx(1.0)
    assert found["attrs"]["spacing"] == {
        "value": corridor.spacing, "unit": "m", "text": "Distance between cell centres.",
    }  # fmt: skip
    assert all(one["text"] for one in found["attrs"].values())
    assert found["figures"]["free_area_m2"] == pytest.approx(corridor.free_area)


def test_values_are_those_that_the_map_samples(live: Live, turning: an.AmbiguityMap) -> None:
    service = an.AmbiguityService(turning)
    for x, y, theta in ((1.13, 0.77, 0.4), (0.2, 1.8, -2.0), (3.9, 0.1, 7.0)):
        found = live.get("/v1/maps/narrow-room/values", x=x, y=y, theta=theta)
        for layer in turning.layers:
            value = turning.sample(layer, x, y, theta)
            told = found["values"][layer]
            if layer.startswith("zone") and not value < len(ZONES):
                value = math.nan
            assert told is None if math.isnan(value) else told == pytest.approx(value, abs=1e-6)
        cost = service.cost(x, y, theta)
        assert found["cost"] == pytest.approx(cost) if math.isfinite(cost) else not found["cost"]


def test_without_theta_means_over_headings_are_told(live: Live, turning: an.AmbiguityMap) -> None:
    found = live.get("/v1/maps/narrow-room/values", x=2.0, y=1.0)
    assert found["values"]["level"] == pytest.approx(turning.sample("level_mean", 2.0, 1.0))
    assert found["theta"] is None
    assert found["cost"] == pytest.approx(an.AmbiguityService(turning, "level_mean").cost(2.0, 1.0))
    assert found["zone"] in ZONES
    assert found["nearest"]["theta"] is None


@pytest.mark.parametrize(
    ("x", "y", "reason"),
    [
        ("-50", "1", "outside"),
        ("nan", "1", "outside"),
        ("1", "inf", "outside"),
        ("1e308", "-1e308", "outside"),
        ("6", "2.8", "unknown"),
    ],
)
def test_where_there_is_no_value_a_reason_is_told(live: Live, x: str, y: str, reason: str) -> None:
    found = live.get("/v1/maps/map/values", x=x, y=y)
    assert found["reason"] == reason
    assert found["cost"] is None and found["zone"] is None
    assert {name for name, value in found["values"].items() if value is not None} <= {"free"}
    assert live.get("/v1/maps/map/cost", x=x, y=y) == {"cost": None, "reason": reason}


def test_in_a_pillar_there_is_a_wall(live: Live) -> None:
    assert live.get("/v1/maps/narrow-room/values", x=3.3, y=0.8)["reason"] == "wall"


def test_the_expected_scan_ends_on_walls_or_at_its_range(
    live: Live, corridor: an.AmbiguityMap
) -> None:
    x, y = 1.5, 1.5
    found = live.get("/v1/maps/map/scan", x=x, y=y, theta=0.3)
    ends = np.column_stack([found["x"], found["y"]])
    hit = np.array(found["hit"])
    assert len(ends) == 36 and hit.any()
    walls = shapely.multilinestrings(
        shapely.linestrings(corridor.segments.xy.reshape(-1, 2, 2)).tolist()
    )
    assert (shapely.distance(walls, shapely.points(ends[hit])) < 1e-6).all()
    np.testing.assert_allclose(np.hypot(*(ends[~hit] - (x, y)).T), 2.0, rtol=1e-6)
    nowhere = live.get("/v1/maps/map/scan", x=-9, y=0)
    assert nowhere["x"] == [] and nowhere["hit"] == []


def test_worst_places_are_those_of_the_audit(live: Live, corridor: an.AmbiguityMap) -> None:
    from ambinav.audit.ambiguous_regions import find_ambiguous_regions

    found = live.get("/v1/maps/map/worst")
    regions = find_ambiguous_regions(corridor)
    assert [(one["x"], one["y"], one["zone"]) for one in found] == [
        (region.x, region.y, region.zone) for region in regions
    ]


def test_zones_cover_the_floor(live: Live, corridor: an.AmbiguityMap) -> None:
    found = live.get("/v1/maps/map/zones.geojson")
    whole = shapely.from_geojson(live.http.get("/v1/maps/map/zones.geojson").text)
    assert whole.is_valid
    areas = {one["properties"]["zone"]: one["properties"]["area_m2"] for one in found["features"]}
    for share in corridor.zone_shares():
        assert areas.get(share.zone, 0.0) == pytest.approx(share.area, abs=1e-6)
    zone = corridor.dataset["zone"].values
    for one in found["features"]:
        shape = shapely.geometry.shape(one["geometry"])
        assert shape.geom_type == "MultiPolygon"
        assert all(part.exterior.is_ccw for part in shape.geoms)  # RFC 7946, section 3.1.6
        x, y = np.meshgrid(corridor.dataset["x"].values, corridor.dataset["y"].values)
        code = ZONES.index(one["properties"]["zone"])
        np.testing.assert_array_equal(shapely.contains_xy(shape, x, y), zone == code)


def test_walls_are_the_segments(live: Live, corridor: an.AmbiguityMap) -> None:
    features = live.get("/v1/maps/map/walls.geojson")["features"]
    kinds = {one["properties"]["kind"]: one["geometry"]["coordinates"] for one in features}
    segments = corridor.segments
    np.testing.assert_array_equal(
        np.array(kinds["wall"]).reshape(-1, 4), segments.xy[segments.walls]
    )
    assert len(kinds["frontier"]) == int((~segments.walls).sum()) > 0


def test_weak_directions_lie_along_the_corridor(live: Live) -> None:
    found = live.get("/v1/maps/map/direction", bbox="5,1,9,2.5", max=20)
    assert 0 < len(found) <= 20
    for one in found:
        assert 5 <= one["x"] <= 9 and 1 <= one["y"] <= 2.5
        assert abs(math.sin(one["direction"])) < 0.1
        assert one["major"] > one["minor"]
    assert live.get("/v1/maps/map/direction", bbox="900,900,901,901") == []
    assert live.http.get("/v1/maps/map/direction", params={"bbox": "1,2,3"}).status_code == 422


def test_an_unknown_map_is_a_problem_that_offers_the_nearest(live: Live) -> None:
    answer = live.http.get("/v1/maps/mapp/values", params={"x": 1, "y": 1})
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.json() == {
        "type": "about:blank",
        "title": "Not Found",
        "status": 404,
        "detail": "There is no map 'mapp'; did you mean map.",
        "field": "id",
    }


def test_ids_are_unique(plan_map, serve) -> None:  # type: ignore[no-untyped-def]
    live = serve([plan_map, plan_map])
    assert [one["id"] for one in live.get("/v1/maps")["maps"]] == ["map", "map-2"]
