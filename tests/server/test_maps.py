"""What the service tells of maps and of single poses, against the maps themselves."""

from __future__ import annotations

import asyncio
import gc
import math
import re
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.maps.zones import NOT_FREE, ZONES
from ambinav.runtime.errors import InputError
from ambinav.server.http.context import Context
from ambinav.server.limits import Limits
from ambinav.server.served import ServedMap, ServedMaps
from ambinav.server.tiles.pyramids import Pyramids
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
            served = found["values"][layer]
            if layer.startswith("zone") and not value < len(ZONES):
                value = math.nan
            assert served is None if math.isnan(value) else served == pytest.approx(value, abs=1e-6)
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
    from ambinav.studies.audit.ambiguous_regions import find_ambiguous_regions

    found = live.get("/v1/maps/map/worst")
    regions = find_ambiguous_regions(corridor)
    assert [(one["x"], one["y"], one["zone"]) for one in found] == [
        (region.x, region.y, region.zone) for region in regions
    ]


def test_zones_cover_the_floor(live: Live, corridor: an.AmbiguityMap) -> None:
    found = live.get("/v1/maps/map/zones.geojson")
    assert MAP_FRAME.items() <= found.items()
    whole = shapely.from_geojson(live.http.get("/v1/maps/map/zones.geojson").text)
    assert whole.is_valid
    areas = {one["properties"]["zone"]: one["properties"]["area_m2"] for one in found["features"]}
    for share in corridor.zone_shares(mask=corridor.judged.counted):
        assert areas.get(share.zone, 0.0) == pytest.approx(share.area, abs=1e-6)
    zone = np.where(corridor.judged.counted, corridor.dataset["zone"].values, NOT_FREE)
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


def test_reflectors_are_walls_and_told_apart(serve: Callable[..., Live]) -> None:
    """They are among the walls, and once more by themselves."""
    room = shapely.box(0, 0, 4, 3)
    environment = an.environment_from_shapes([room], reflectors=[[(1, 0), (2, 0)]], name="tagged")
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=1.5, std=0.02, resolution=0.01), beams=12, aperture=math.tau
    )
    live = serve([an.build_map(environment, scanner, spacing=0.5)])
    features = live.get("/v1/maps/tagged/walls.geojson")["features"]
    lengths = {
        one["properties"]["kind"]: shapely.geometry.shape(one["geometry"]).length
        for one in features
    }
    assert lengths == pytest.approx({"wall": 14.0, "reflector": 1.0})


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


def test_ids_keep_underscores_and_case(corridor: an.AmbiguityMap) -> None:
    maps = ServedMaps()
    names = [maps.add(corridor, stem).name for stem in ("belg_tb3", "Hall_B", "hall 2", "a--b")]
    assert names == ["belg_tb3", "Hall_B", "hall-2", "a-b"]


def test_unknown_query_parameters_are_refused_everywhere(live: Live) -> None:
    for path, operations in live.get("/openapi.json")["paths"].items():
        address = re.sub(r"\{\w+\}", "map", path)
        for method, operation in operations.items():
            if operation["tags"] == ["server"]:  # whoever watches may add to the address
                continue
            answer = live.http.request(method.upper(), f"{address}?n=-1")
            assert (answer.status_code, answer.json()["field"]) == (422, "n"), (method, path)
    answer = live.http.get("/v1/maps/map/values?x=1&y=1&heading=45")
    assert answer.status_code == 422
    assert "'heading'; it has x, y, theta, weight." in answer.json()["detail"]


def test_values_tell_the_cost_at_a_weight(live: Live, turning: an.AmbiguityMap) -> None:
    found = live.get("/v1/maps/narrow-room/values", x=2.0, y=1.0, weight=1.0)
    service = an.AmbiguityService(turning, "level_mean", 1.0)
    assert found["cost"] == pytest.approx(service.cost(2.0, 1.0))


def test_what_is_worked_out_once_is_waited_for_by_all(corridor: an.AmbiguityMap) -> None:
    served = ServedMap("map", corridor, "map")
    calls: list[str] = []
    release = threading.Event()

    def work(served: ServedMap) -> int:
        calls.append(served.name)
        assert release.wait(10.0)
        if len(calls) == 1:
            raise InputError("not this time.")
        return 7

    async def many() -> list[Any]:
        context = Context(ServedMaps(), Limits())
        first = [asyncio.create_task(context.once(served, "seven", work)) for _ in range(5)]
        while not calls:
            await asyncio.sleep(0)
        first[0].cancel()  # whoever goes away takes nobody else's answer along
        await asyncio.gather(first[0], return_exceptions=True)
        release.set()
        failed = await asyncio.gather(*first[1:], return_exceptions=True)
        again = await context.once(served, "seven", work)
        assert served not in context._results  # which is of no map that is served
        return [*failed, again]

    *failed, found = asyncio.run(many())
    assert [str(one) for one in failed] == ["not this time."] * 4
    assert (found, calls) == (7, ["map", "map"])


def test_nothing_is_kept_of_a_map_that_is_forgotten(corridor: an.AmbiguityMap) -> None:
    context = Context(ServedMaps(), Limits())
    first, second = (context.maps.add(corridor, name) for name in ("a", "b"))
    paths = [context.file_of(one) for one in (first, second)]
    context.forget(first)
    assert [path.exists() for path in paths] == [False, True]
    assert context.file_of(context.maps.add(corridor, "c")) not in paths
    held = gc.get_referrers(first)
    assert not [one for one in held if isinstance(one, dict) and first in one]
    asyncio.run(context.close())


def test_a_pyramid_that_cannot_be_kept_does_not_end_the_others(
    corridor: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    context = Context(ServedMaps(), Limits())
    names = [context.maps.add(corridor, name).name for name in ("a", "b")]

    def fail(*_: object) -> bool:
        raise ValueError("no room")

    monkeypatch.setattr(Pyramids, "keep", fail)
    context.keep_pyramids(threading.Event())
    assert [record.args for record in caplog.records] == [(name,) for name in names]
