"""Edited maps: the same as a direct update, kept in bounds, and the original untouched."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import socket
import threading
from collections.abc import Callable
from multiprocessing import Pipe
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.obstacle_file import DrawnObstacle, collection, obstacles_of
from ambinav.sensing.intensity import Intensity
from ambinav.server.jobs import workers
from ambinav.server.jobs.edit_sessions import SUPERSEDED, EditedMap, EditPool
from ambinav.server.jobs.workers import EditTask
from ambinav.server.limits import Limits
from ambinav.server.problems import Problem
from ambinav.server.served import ServedMap
from ambinav.server.wire import write_dataset
from tests.server.idle_edits import until_stopped
from tests.server.live import Live, wait_until

EDITS = "/v1/maps/map/edits"
POST = DrawnObstacle("post", ((7.0, 1.6),), radius=0.15)
WALL = DrawnObstacle("wall", ((5.0, 1.0), (5.0, 1.6)), thickness=0.1)
LONG = DrawnObstacle("wall", tuple((5 + k / 1e3, 1.5) for k in range(1001)))
STRIP = DrawnObstacle("reflector", ((8.0, 1.5), (8.6, 1.5)))


def posts(count: int, shift: float = 0.0) -> list[Any]:
    """Different bodies of one post each."""
    return [
        collection([DrawnObstacle("post", ((4.0 + k, 1.7 + shift),), radius=0.1)])
        for k in range(count)
    ]


@pytest.fixture
def no_work(corridor: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch) -> None:
    """Edits change nothing, at once, and take no process."""

    async def run(self: EditPool, task: EditTask) -> None:
        write_dataset(corridor.dataset, Path(task.out))

    monkeypatch.setattr(EditPool, "run", run)


@pytest.fixture(scope="module")
def edited(live: Live) -> dict[str, Any]:
    """The answer to an edit of three obstacles."""
    answer = live.http.post(EDITS, json=collection([POST, WALL, STRIP]))
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


@pytest.fixture(scope="module")
def direct(corridor: an.AmbiguityMap) -> an.AmbiguityMap:
    """The map that `update` gives of the same building."""
    obstacles = [one.obstacle for one in (POST, WALL, STRIP)]
    return corridor.update(corridor.environment.edited(add=obstacles))


@pytest.mark.slow
def test_an_edited_map_is_the_update_and_the_original_stays(
    live: Live, edited: dict[str, Any], direct: an.AmbiguityMap, plan_map: Path
) -> None:
    served = live.context.maps.get(edited["id"])
    assert isinstance(served, EditedMap)
    for name in direct.layers:
        np.testing.assert_array_equal(
            served.amap.dataset[name].values, direct.dataset[name].values, err_msg=name
        )
    np.testing.assert_array_equal(served.amap.segments.xy, direct.segments.xy)
    np.testing.assert_array_equal(served.amap.segments.kind, direct.segments.kind)
    assert live.context.maps.get("map").amap.dataset.identical(
        an.AmbiguityMap.open(plan_map).dataset
    )


@pytest.mark.slow
def test_a_building_in_space_is_edited_with_heights(serve: Callable[..., Live]) -> None:
    """A post that the scanner looks over, and one that it sees."""
    plan = an.environment_from_shapes([shapely.box(0, 0, 8, 6)], name="hall")
    building = plan.in_space(an.extruded(plan, 2.5))
    sensor = an.RangeSensor(max_range=2.5, std=0.03, resolution=0.001)
    scanner = an.RangeScanner.planar(sensor, 40, math.tau, (0.0, 0.0, 0.003)).raised(0.3)
    amap = an.build_map(building, scanner, spacing=0.25, store=False)
    live, better = serve([amap]), []
    for top in (0.2, 1.0):
        drawn = DrawnObstacle("post", ((4.0, 3.0),), radius=0.15, top=top)
        answer = live.http.post("/v1/maps/hall/edits", json=collection([drawn]))
        assert answer.status_code == 200, answer.text
        edit = answer.json()
        better.append(edit["bad_before_m2"] - edit["bad_after_m2"])
        expected = amap.update(building.edited([drawn.obstacle]))
        served = live.context.maps.get(edit["id"]).amap
        level = [m.dataset["level"].values for m in (served, expected)]
        np.testing.assert_array_equal(*level)
    assert better[1] > better[0] + 1.0


@pytest.mark.slow
def test_the_answer_compares_zones(
    edited: dict[str, Any], corridor: an.AmbiguityMap, direct: an.AmbiguityMap
) -> None:
    assert (edited["map"], edited["obstacles"]) == ("map", 3)
    for amap, when in ((corridor, "before"), (direct, "after")):
        shares = amap.zone_shares(mask=amap.judged.counted)
        areas = [share.area for share in shares]
        assert [zone[f"{when}_m2"] for zone in edited["zones"]] == pytest.approx(areas)
        assert edited[f"bad_{when}_m2"] == pytest.approx(areas[2] + areas[3])
    assert edited["bad_after_m2"] < edited["bad_before_m2"]


@pytest.mark.slow
def test_all_routes_answer_for_it(
    live: Live, edited: dict[str, Any], direct: an.AmbiguityMap
) -> None:
    path = f"/v1/maps/{edited['id']}"
    found = live.get(f"{path}/values", x=6.1, y=1.7)
    assert found["values"]["level"] == pytest.approx(direct.sample("level", 6.1, 1.7))
    assert live.get(f"{path}/values", x=7.0, y=1.6)["reason"] == "wall"
    assert live.get(path)["name"] == "map, edited"
    scan = live.get(f"{path}/scan", x=6.5, y=1.6)
    assert min(np.hypot(np.array(scan["x"]) - 6.5, np.array(scan["y"]) - 1.6)) < 0.36
    tiles = f"{path}/layers/zone/tiles/0/0/0.png"
    original = "/v1/maps/map/layers/zone/tiles/0/0/0.png"
    assert live.http.get(tiles).content != live.http.get(original).content
    scales = [live.get(f"/v1/maps/{one}/layers/clearance") for one in ("map", edited["id"])]
    assert scales[0] == scales[1]  # to be compared by eye
    for name in ("worst", "zones.geojson", "walls.geojson", "direction"):
        assert live.http.get(f"{path}/{name}").status_code == 200, name


def test_what_was_drawn_and_what_came_of_it_can_be_fetched(
    live: Live, edited: dict[str, Any], direct: an.AmbiguityMap, tmp_path: Path
) -> None:
    path = f"/v1/maps/{edited['id']}"
    assert obstacles_of(live.get(f"{path}/obstacles.geojson"), "x") == (POST, WALL, STRIP)
    assert live.get("/v1/maps/map/obstacles.geojson")["features"] == []
    plan = tmp_path / "plan.geojson"
    plan.write_bytes(live.http.get(f"{path}/building.geojson").content)
    building = an.load_environment(plan)
    assert building.free.area == pytest.approx(direct.environment.free.area)
    assert building.cast(6.0, 1.6, 0.0, 5.0) == pytest.approx(0.85, abs=0.01)


def test_the_same_obstacles_are_the_same_map(live: Live, edited: dict[str, Any]) -> None:
    again = live.http.post(f"{EDITS}?session=other", json=collection([POST, WALL, STRIP])).json()
    assert again["id"] == edited["id"]
    assert again["seconds"] < 0.1
    assert live.get("/v1/maps")["maps"][0]["id"] == "map"
    assert len(live.get("/v1/maps")["maps"]) == 2  # edited ones are not listed


def test_no_obstacle_is_the_original(live: Live) -> None:
    found = live.http.post(EDITS, json=collection([])).json()
    assert (found["id"], found["obstacles"]) == ("map", 0)
    assert found["bad_before_m2"] == found["bad_after_m2"]


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    one = {"type": "Feature", "geometry": geometry, "properties": properties}
    return {"type": "FeatureCollection", "features": [one]}


POINT = {"type": "Point", "coordinates": [7.0, 1.7]}
LINE = {"type": "LineString", "coordinates": [[7.0, 1.7], [8.0, 1.7]]}


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({}, "type"),
        ({"type": "FeatureCollection"}, "features"),
        (feature(POINT, kind="pillar", radius=1), "kind"),
        (feature(POINT, kind="post"), "radius is None"),
        (feature(POINT, kind="post", radius=0), "radius"),
        (feature(POINT, kind="post", radius="1"), "radius"),
        (feature(POINT, kind="wall", radius=1), "draw it as a LineString"),
        (feature(LINE, kind="wall", thickness=21), "thickness"),
        (feature(LINE | {"coordinates": [[7, 1]]}, kind="wall"), "at least 2"),
        (feature(LINE | {"coordinates": [[7, 1], [7, 1]]}, kind="wall"), "0 m long"),
        (feature(LINE | {"coordinates": [[7, 1], [7]]}, kind="wall"), "at least 2"),
        (feature({"type": "Polygon", "coordinates": []}, kind="wall"), "type"),
        (feature(POINT | {"coordinates": [99, 1]}, kind="post", radius=1), "outside of the map"),
        (feature(POINT | {"coordinates": [12, 2]}, kind="post", radius=0.1), "outside the floor"),
        (feature(POINT, kind="post", radius=20), "cover all"),
        (collection([POST] * 101), "takes 100"),
        (collection([LONG]), "1001"),
    ],
)  # fmt: skip
def test_what_cannot_be_put_in_is_a_problem(live: Live, body: Any, words: str) -> None:
    answer = live.http.post(EDITS, json=body)
    assert answer.status_code == 422, answer.text
    assert words in answer.json()["detail"]
    assert answer.json()["detail"].count(". ") == 0


def test_not_a_number_is_a_problem(live: Live) -> None:
    text = json.dumps(collection([POST])).replace("7.0", "NaN")
    answer = live.http.post(EDITS, content=text, headers={"content-type": "application/json"})
    assert answer.status_code in (400, 422)


def test_edits_of_edited_and_of_unknown_maps_are_refused(
    live: Live, edited: dict[str, Any]
) -> None:
    answer = live.http.post(f"/v1/maps/{edited['id']}/edits", json=posts(1)[0])
    assert answer.status_code == 422
    assert "'map'" in answer.json()["detail"]
    assert live.http.post("/v1/maps/office/edits", json=posts(1)[0]).status_code == 404
    missing = live.http.get("/v1/maps/map--0123456789abcdef")
    assert missing.status_code == 404
    assert "again" in missing.json()["detail"]
    assert live.http.post(f"{EDITS}?session=a+b", json=posts(1)[0]).status_code == 422


def test_a_map_with_headings_is_edited_too(live: Live, turning: an.AmbiguityMap) -> None:
    one = DrawnObstacle("panel", ((1.0, 0.5), (1.0, 1.5)))
    found = live.http.post("/v1/maps/narrow-room/edits", json=collection([one])).json()
    wanted = turning.update(turning.environment.edited(add=[one.obstacle]))
    served = live.context.maps.get(found["id"])
    np.testing.assert_array_equal(
        served.amap.dataset["level"].values, wanted.dataset["level"].values
    )


def test_where_a_rim_is_built_over_the_lattice_stays(live: Live, corridor: an.AmbiguityMap) -> None:
    thick = DrawnObstacle("wall", ((0.0, 0.0), (0.0, 3.0)), thickness=2.0)
    found = live.http.post(EDITS, json=collection([thick])).json()
    wanted = corridor.update(corridor.environment.edited(add=[thick.obstacle]))
    served = live.context.maps.get(found["id"])
    assert wanted.possible.shape != corridor.possible.shape
    assert served.amap.bounds == corridor.bounds
    there = served.amap.dataset.sel(x=wanted.dataset["x"], method="nearest")
    for name in wanted.layers:
        # Kernels that each process compiles for itself may round the last bit in another way.
        np.testing.assert_allclose(there[name].values, wanted.dataset[name].values, rtol=1e-5)
        assert served.amap.dataset[name].dtype == corridor.dataset[name].dtype
    beside = live.get(f"/v1/maps/{found['id']}/values", x=0.5, y=1.5)
    assert beside["values"]["level"] is None


@pytest.mark.usefixtures("no_work")
def test_only_so_many_are_kept_and_nobody_loses_by_another(
    serve: Callable[..., Live], corridor: an.AmbiguityMap
) -> None:
    live = serve([corridor], limits=Limits(kept_edits=3))
    path = "/v1/maps/environment/edits"

    def post(body: Any, session: str) -> str:
        answer = live.http.post(f"{path}?session={session}", json=body)
        assert answer.status_code == 200, answer.text
        return str(answer.json()["id"])

    mine = post(posts(1)[0], "mine")
    live.http.get(f"/v1/maps/{mine}/layers/zone/tiles/0/0/0.png")
    theirs = [post(body, "theirs") for body in posts(4, 0.2)]
    kept = [one.name for one in live.context.maps.edited]
    assert kept == [mine, *theirs[-2:]]
    assert live.http.get(f"/v1/maps/{theirs[0]}").status_code == 200  # it is computed again
    assert [one.name for one in live.context.maps.edited] == [mine, theirs[-1], theirs[0]]
    assert live.http.get(f"/v1/maps/{theirs[0]}0").status_code == 404
    assert live.http.get(f"/v1/maps/{mine}").status_code == 200
    # Of what was forgotten nothing is left.
    assert {one.name for one in live.context._tiles} <= {"environment", mine}
    assert {one.name for one in live.context._results} <= {
        "environment", *(one.name for one in live.context.maps.edited)
    }  # fmt: skip
    assert [one.name for one in live.context.folder.glob("edit-*")] == []


@pytest.mark.usefixtures("no_work")
def test_edits_are_kept_by_their_size_too(
    serve: Callable[..., Live], corridor: an.AmbiguityMap
) -> None:
    live = serve([corridor], limits=Limits(edit_bytes=int(1.5 * corridor.dataset.nbytes)))
    found = [
        live.http.post("/v1/maps/environment/edits", json=one).json()["id"] for one in posts(2)
    ]
    assert [one.name for one in live.context.maps.edited] == found[1:]


@pytest.mark.usefixtures("no_work")
def test_edits_go_with_their_original(
    serve: Callable[..., Live], corridor: an.AmbiguityMap
) -> None:
    live = serve([corridor])
    id = live.http.post("/v1/maps/environment/edits", json=posts(1)[0]).json()["id"]
    edited = live.context.maps.get(id)
    live.context.forget(live.context.maps.get("environment"))
    assert live.context.maps.edited == ()
    with pytest.raises(Problem, match="no longer served"):
        live.context.file_of(edited)
    live.context.tiles(edited)
    assert edited not in live.context._tiles


@pytest.mark.slow
def test_the_latest_edit_of_a_session_wins(
    serve: Callable[..., Live], corridor: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EditPool, "work", staticmethod(until_stopped))
    # On a busy machine a process may be slow to stop, and would be replaced.
    monkeypatch.setattr("ambinav.server.jobs.edit_sessions.STOP_SECONDS", 50.0)
    live = serve([corridor], limits=Limits(waiting=1))
    path, answers = "/v1/maps/environment/edits?session=one", []
    pool = live.context.edits.pool

    def ask(body: Any) -> threading.Thread:
        thread = threading.Thread(target=lambda: answers.append(live.http.post(path, json=body)))
        thread.start()
        return thread

    bodies = posts(4)
    first = ask(bodies[0])
    wait_until(lambda: pool.busy)
    (worker,) = pool.busy
    for body in bodies[1:]:
        later = ask(body)
        first.join(60.0)
        assert not first.is_alive()
        assert answers[-1].status_code == 409
        assert answers[-1].json()["detail"] == SUPERSEDED
        wait_until(lambda: pool.busy == {worker})  # it has left the one and taken the other
        first = later
    # Whoever goes away takes no process along either.
    body = json.dumps(bodies[0])
    with socket.create_connection(live.address, timeout=60.0) as line:
        line.sendall(
            f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json"
            f"\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode()
        )
        first.join(60.0)
    wait_until(lambda: not pool.busy)
    assert worker.process.is_alive()
    assert live.context.maps.edited == ()


def test_sessions_of_one_name_on_two_maps_are_two(
    serve: Callable[..., Live], corridor: an.AmbiguityMap, turning: an.AmbiguityMap
) -> None:
    live = serve([corridor, turning])
    edits, maps = live.context.edits, [*live.context.maps]
    asked: list[str] = []

    async def find(base: ServedMap, *_: object) -> ServedMap:
        asked.append(base.name)
        while len(asked) < 2:
            await asyncio.sleep(0.001)
        return base

    async def both() -> list[Any]:
        edits._find = find  # type: ignore[method-assign, assignment]
        return await asyncio.gather(*(edits.find(base, (), "team") for base in maps))

    assert [found.name for found, _ in asyncio.run(both())] == [base.name for base in maps]


@pytest.mark.slow
def test_an_edit_that_takes_too_long_is_ended(
    serve: Callable[..., Live], corridor: an.AmbiguityMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EditPool, "work", staticmethod(until_stopped))
    live = serve([corridor], limits=Limits(edit_seconds=0.2))
    answer = live.http.post("/v1/maps/environment/edits", json=posts(1)[0])
    assert answer.status_code == 504
    assert "0.2 s" in answer.json()["detail"]
    assert not live.context.edits.pool.busy


def test_a_process_leaves_an_edit_that_is_stopped(
    corridor: an.AmbiguityMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, rounds = threading.Event(), []

    def edit(amap: Any, task: EditTask, report: Callable[[float], None]) -> None:
        begun.set()
        for _ in range(100_000):
            rounds.append(task.out)
            report(0.5)
            if task.out == "last":
                return
            threading.Event().wait(0.001)

    monkeypatch.setattr(workers, "edit", edit)
    monkeypatch.setattr(workers, "read_map", lambda path, source: corridor)
    ours, theirs = Pipe()

    def work() -> None:
        with contextlib.suppress(EOFError):
            workers.edits(theirs)

    thread = threading.Thread(target=work)
    thread.start()
    ours.send(EditTask("map", "map", (), "first"))
    assert begun.wait(60.0)
    ours.send(None)
    assert ours.poll(60.0) and ours.recv() is None
    ours.send(None)  # too late for the first one, and nothing to the last one
    ours.send(EditTask("map", "map", (), "last"))
    assert ours.poll(60.0) and ours.recv() is None
    assert rounds[-1] == "last" and len(rounds) < 100_000
    assert not ours.poll(0.0)
    ours.close()
    thread.join(60.0)


@pytest.mark.slow
def test_a_tag_on_a_wall_helps_a_scanner_that_reads_intensities(serve: Callable[..., Live]) -> None:
    room = shapely.box(0.0, 0.0, 12.0, 1.5)
    tag = DrawnObstacle("reflector", ((6.0, 1.5), (6.3, 1.5)))
    for intensity in (None, Intensity(wall=50.0, reflector=250.0, std=20.0)):
        sensor = an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01, intensity=intensity)
        scanner = an.RangeScanner.planar(sensor=sensor, beams=36, aperture=math.tau)
        environment = an.environment_from_shapes([room], name="corridor")
        live = serve([an.build_map(environment, scanner, spacing=0.2)])
        found = live.http.post("/v1/maps/corridor/edits", json=collection([tag])).json()
        assert (found["bad_after_m2"] < found["bad_before_m2"]) == (intensity is not None)
        walls = live.get(f"/v1/maps/{found['id']}/walls.geojson")["features"]
        assert "reflector" in [one["properties"]["kind"] for one in walls]
