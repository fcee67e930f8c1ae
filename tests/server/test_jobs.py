"""Plans and audits in processes of their own."""

from __future__ import annotations

import asyncio
import io
import json
import os
import shutil
import socket
import struct
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from PIL import Image
from starlette.requests import Request

import ambinav as an
from ambinav.runtime.errors import InputError
from ambinav.server.jobs.audit_jobs import OVER, Audit, Audits
from ambinav.server.jobs.plan_jobs import Turns, received, started, while_connected
from ambinav.server.jobs.state import State
from ambinav.server.jobs.uploads import store
from ambinav.server.jobs.workers import AuditTask, _check_size, plans
from ambinav.server.limits import Limits
from ambinav.server.problems import OURS, Problem
from ambinav.server.served import ServedMaps
from ambinav_planners import RoutePlanner, pareto
from tests.server.live import Live, wait_until

ENDS = {"start": [1, 1], "goal": [10, 2]}
LONG = ENDS | {"planner": "rrtstar", "time_s": 30}


@pytest.mark.slow
def test_a_plan_is_the_planners(live: Live, corridor: an.AmbiguityMap) -> None:
    answer = live.http.post("/v1/maps/map/plan", json=ENDS | {"weight": 3.0})
    assert answer.status_code == 200, answer.text
    found = answer.json()
    route = RoutePlanner(an.AmbiguityService(corridor)).plan((1, 1), (10, 2), weight=3.0)
    np.testing.assert_array_equal(found["route"], route.poses[:, :2])
    assert (found["length"], found["cost"], found["exposure"]) == (
        route.length, route.cost, route.exposure,
    )  # fmt: skip
    front = live.http.post("/v1/maps/map/pareto", json=ENDS | {"weights": [0, 5]}).json()
    wanted = pareto(RoutePlanner(an.AmbiguityService(corridor)), (1, 1), (10, 2), weights=(0, 5))
    assert [(one["weight"], one["length"]) for one in front] == [
        (point.weight, point.route.length) for point in wanted.points
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "message"),
    [
        (ENDS | {"goal": [14, 1]}, "no path leads"),
        (ENDS | {"start": [-5, 1]}, "outside"),
        (ENDS | {"planner": "rrtstra"}, "rrtstar"),
        (ENDS | {"layer": "levle"}, "level"),
        (ENDS | {"time_s": 1000}, "at most 30"),
        (ENDS | {"time_s": -1}, "time_s"),
        (ENDS | {"weight": -1}, "weight"),
        (ENDS | {"start": [1]}, "start"),
        (ENDS | {"start": [1, None]}, "start"),
        ({"start": [1, 1]}, "goal"),
    ],
)
def test_a_plan_that_cannot_be_is_a_problem(live: Live, body: Any, message: str) -> None:
    answer = live.http.post("/v1/maps/map/plan", json=body)
    assert answer.status_code == 422, answer.text
    assert message in answer.json()["detail"]


@pytest.mark.slow
def test_closing_the_connection_ends_the_plan_and_frees_its_worker(
    serve: Any, plan_map: Path
) -> None:
    live: Live = serve([plan_map], limits=Limits(plans=1, waiting=0))
    pool, body = live.context.plans, json.dumps(LONG)
    with socket.create_connection(live.address, timeout=60.0) as line:
        line.sendall(
            "POST /v1/maps/map/plan HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json"
            f"\r\nContent-Length: {len(body)}\r\n\r\n{body}".encode()
        )
        wait_until(lambda: pool.busy)
        (worker,) = pool.busy
        process = psutil.Process(worker.process.pid)
        assert live.http.post("/v1/maps/map/plan", json=ENDS).status_code == 503
    process.wait(60.0)  # of 30 s of planning hardly any are over
    wait_until(lambda: live.http.post("/v1/maps/map/plan", json=ENDS).status_code == 200)


def test_a_folder_that_was_tidied_up_is_made_again(serve: Any, corridor: an.AmbiguityMap) -> None:
    live: Live = serve([corridor])
    path = "/v1/maps/environment/map.npz"
    first = live.http.get(path)
    shutil.rmtree(live.context.folder)
    again = live.http.get(path)
    assert (again.status_code, len(again.content)) == (200, len(first.content))


@pytest.mark.slow
def test_a_plan_that_takes_too_long_is_ended(serve: Any, plan_map: Path) -> None:
    live: Live = serve([plan_map], limits=Limits(job_seconds=0.2))
    answer = live.http.post("/v1/maps/map/plan", json=LONG)
    assert answer.status_code == 504
    assert not live.context.plans.busy


@pytest.mark.slow
def test_a_worker_that_is_killed_is_told_of_and_replaced(serve: Any, plan_map: Path) -> None:
    live: Live = serve([plan_map], limits=Limits(plans=1))
    assert live.http.post("/v1/maps/map/plan", json=ENDS).status_code == 200
    (worker,) = live.context.plans._idle
    worker.process.kill()
    worker.process.join(10.0)
    assert live.http.post("/v1/maps/map/plan", json=ENDS).status_code == 200


def test_no_more_wait_than_there_are_places() -> None:
    async def many() -> list[str]:
        turns = Turns(1, 1, "plans")
        release = asyncio.Event()
        order: list[str] = []

        async def job(name: str) -> None:
            async with turns:
                order.append(name)
                await release.wait()

        first, second = asyncio.create_task(job("first")), asyncio.create_task(job("second"))
        await asyncio.sleep(0)
        with pytest.raises(Problem) as caught:
            await job("third")
        assert caught.value.status_code == 503
        second.cancel()  # whoever waits may go, and leaves the place to another
        await asyncio.gather(second, return_exceptions=True)
        fourth = asyncio.create_task(job("fourth"))
        release.set()
        await asyncio.gather(first, fourth)
        return order

    assert asyncio.run(many()) == ["first", "fourth"]


class Sent:
    """An uploaded file, as far as `store` looks at it."""

    def __init__(self, filename: str, content: bytes) -> None:
        self.filename, self.file = filename, io.BytesIO(content)


def grid() -> bytes:
    """A PNG of a small room."""
    cells = np.zeros((40, 60), dtype=np.uint8)
    cells[2:-2, 2:-2] = 254
    out = io.BytesIO()
    Image.fromarray(cells).save(out, "PNG")
    return out.getvalue()


HEADER = "resolution: 0.1\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.25\n"


def test_no_name_of_an_upload_is_opened(tmp_path: Path) -> None:
    secret = tmp_path / "secret.png"
    secret.write_bytes(b"not yours")
    folder = tmp_path / "upload"
    folder.mkdir()
    header = f"image: {secret}\n{HEADER}other: !!python/name:os.system\n".replace("other", "#")
    upload = store(
        [Sent("../../../map.yaml", header.encode()), Sent("..\\evil.png", grid())],  # type: ignore[list-item]
        folder,
    )
    assert sorted(path.name for path in folder.iterdir()) == ["image.png", "map.yaml"]
    assert "image: image.png" in (folder / "map.yaml").read_text()
    assert upload.title == "map"
    assert an.load_environment(folder / upload.file).bounds[2] > 3.0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["secret.png", "upload"]


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([("map.yaml", b"image: /etc/passwd\n")], "image of the map_server file is missing"),
        ([("map.yaml", b"- 1\n"), ("a.png", b"")], "not a map_server file"),
        ([("map.yaml", b"a: [\n"), ("a.png", b"")], "not valid YAML"),
        ([("map.yaml", b"#" * 200_000), ("a.png", b"")], "bytes"),
        ([("map.yaml", b"!!python/object/apply:os.system [ls]"), ("a.png", b"")], "not valid YAML"),
        ([("plan.geojson", b"{}"), ("a.png", b"")], "has no image"),
        ([("plan.geojson", b"{}"), ("b.wkt", b"")], "send one map"),
        ([("archive.zip", b"PK")], "send one map"),
        ([("", b"")], "send one map"),
    ],
)
def test_an_upload_that_is_no_map_is_refused(
    tmp_path: Path, files: list[tuple[str, bytes]], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        store([Sent(*one) for one in files], tmp_path)  # type: ignore[arg-type]


def test_an_image_that_is_large_in_memory_alone_is_refused(tmp_path: Path) -> None:
    out = io.BytesIO()
    Image.new("1", (9000, 9000)).save(out, "PNG")
    assert len(out.getvalue()) < 100_000
    files = [Sent("map.yaml", b"image: a.png\n"), Sent("a.png", out.getvalue())]
    with pytest.raises(InputError, match="81000000 cells"):
        store(files, tmp_path)  # type: ignore[arg-type]


def events(text: str) -> list[tuple[str, Any]]:
    """Server-sent events, as their specification parses them."""
    found = []
    for block in text.split("\n\n"):
        lines = dict(line.split(": ", 1) for line in block.splitlines() if line[:1] != ":")
        if lines:
            found.append((lines["event"], json.loads(lines["data"])))
    return found


@pytest.mark.slow
def test_an_upload_is_audited_and_then_served(
    serve: Any, corridor: an.AmbiguityMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "cache"))
    live: Live = serve([corridor])
    files = [
        ("files", ("hall.yaml", f"image: /etc/hostname\n{HEADER}".encode())),
        ("files", ("hall.png", grid())),
    ]
    form = {"scanner": "sick-lms200", "spacing": "0.5"}
    answer = live.http.post("/v1/audits", files=files, data=form)
    assert answer.status_code == 202, answer.text
    place = answer.headers["location"]
    received = events(live.http.get(f"{place}/events").text)
    assert {name for name, _ in received} == {"progress", "done"}, received
    assert {data["stage"] for name, data in received if name == "progress"} <= {
        "waiting", "read", "map", "report",
    }  # fmt: skip
    done = received[-1][1]
    assert done["map"] == "hall"
    report = live.http.get(done["report"])
    assert report.headers["content-type"].startswith("text/html")
    assert "Ambiguity audit" in report.text and "/tmp" not in report.text
    assert live.get("/v1/maps/hall")["attrs"]["environment_source"]["value"] == "map.yaml"
    assert live.get(place)["state"] == "done"
    assert not (tmp_path / "cache").exists()
    folder = live.context.audits.get(place.rpartition("/")[2]).folder
    assert live.http.delete(place).status_code == 204
    assert live.http.get(place).status_code == 404
    assert live.http.get("/v1/maps/hall").status_code == 404
    assert not folder.exists()


@pytest.mark.slow
def test_an_audit_that_fails_says_why_and_names_no_folder(
    serve: Any, corridor: an.AmbiguityMap
) -> None:
    live: Live = serve([corridor], limits=Limits(audit_cells=10))
    plan = b'{"type": "Polygon", "coordinates": [[[0,0],[9,0],[9,9],[0,9],[0,0]]]}'
    for content, message in ((plan, "this server takes 10"), (b"{}", "plan.geojson")):
        answer = live.http.post(
            "/v1/audits",
            files=[("files", ("a.geojson", content))],
            data={"scanner": "sick-lms200"},
        )
        name, data = events(live.http.get(f"{answer.headers['location']}/events").text)[-1]
        assert name == "failed" and message in data["detail"]
        assert "/tmp" not in data["detail"]
        assert live.http.get(f"{answer.headers['location']}/report").status_code == 409


@pytest.mark.slow
def test_a_plan_s_level_and_unit_are_fields(serve: Any, corridor: an.AmbiguityMap) -> None:
    live: Live = serve([corridor])

    def feature(size: int, level: str) -> dict[str, Any]:
        ring = [[0, 0], [size, 0], [size, size], [0, size], [0, 0]]
        geometry = {"type": "Polygon", "coordinates": [ring]}
        return {"type": "Feature", "properties": {"level": level}, "geometry": geometry}

    def ended(**fields: str) -> tuple[str, dict[str, Any]]:
        answer = live.http.post(
            "/v1/audits",
            files=[("files", ("house.geojson", plan))],
            data={"scanner": "sick-lms200", "spacing": "0.5", **fields},
        )
        assert answer.status_code == 202, answer.text
        return events(live.http.get(f"{answer.headers['location']}/events").text)[-1]

    floors = [feature(3000, "0"), feature(6000, "1")]
    plan = json.dumps({"type": "FeatureCollection", "features": floors}).encode()
    name, data = ended(unit="mm")
    assert name == "failed" and "choose one with the field level" in data["detail"]
    assert "--" not in data["detail"]
    name, data = ended(unit="mm", level="1")
    assert name == "done"
    assert live.get(f"/v1/maps/{data['map']}")["bounds"][2] == pytest.approx(6.0, abs=0.5)


@pytest.mark.slow
def test_an_audit_is_ended_when_it_is_deleted(serve: Any, corridor: an.AmbiguityMap) -> None:
    live: Live = serve([corridor])
    plan = b'{"type": "Polygon", "coordinates": [[[0,0],[60,0],[60,60],[0,60],[0,0]]]}'
    answer = live.http.post(
        "/v1/audits",
        files=[("files", ("a.geojson", plan))],
        data={"scanner": "sick-lms200", "spacing": "0.05"},
    )
    assert live.http.delete(answer.headers["location"]).status_code == 204
    assert live.http.get(answer.headers["location"]).status_code == 404


@pytest.mark.parametrize(
    ("scanner", "unit"),
    [
        ("sick-lms20", "m"),
        ("/etc/passwd", "m"),
        ("a: b\nc: d", "m"),
        ("", "m"),
        ("sick-lms200", "ell"),
    ],
)
def test_a_scanner_and_a_unit_that_are_none_are_a_problem(
    live: Live, scanner: str, unit: str
) -> None:
    data = {"scanner": scanner, "unit": unit}
    answer = live.http.post("/v1/audits", files=[("files", ("a.wkt", b"x"))], data=data)
    assert answer.status_code == 422
    assert "root:" not in answer.text


def test_a_plan_that_is_given_up_while_its_worker_begins_leaves_no_process() -> None:
    async def given_up() -> None:
        before = set(active_children())
        task = asyncio.create_task(started(plans))
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await asyncio.to_thread(wait_until, lambda: set(active_children()) <= before)

    asyncio.run(given_up())


@pytest.mark.parametrize(
    ("scanner", "message"),
    [
        ("name: many\n" + "# remark\n" * 20_000, "at most 100000"),
        (
            "name: many\nparts:\n- sensor: sick-lms200\n  ring: {count: 5000000, radius: 0.1}\n",
            "5000000 beams",
        ),
        (
            'name: "\\ud800"\nparts:\n- sensor: sick-lms200\n  ring: {count: 8, radius: 0.1}\n',
            "an unpaired surrogate",
        ),
    ],
)
def test_a_scanner_that_is_too_much_is_refused(live: Live, scanner: str, message: str) -> None:
    files = [("files", ("hall.wkt", b"POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0))"))]
    answer = live.http.post("/v1/audits", files=files, data={"scanner": scanner})
    assert answer.status_code == 422
    assert message in answer.json()["detail"]


def test_headings_that_the_scanner_decides_count_as_cells() -> None:
    task = AuditTask("", "", "", "", spacing=1.0, radius=0.5, headings=None, cells=100)
    bounds = (0.0, 0.0, 9.0, 9.0)
    _check_size(bounds, an.RangeScanner.from_preset("turtlebot3-lds"), task)
    with pytest.raises(InputError, match="648 cells"):
        _check_size(bounds, an.RangeScanner.from_preset("sick-lms200"), task)


def test_audits_that_come_at_once_find_no_more_places_than_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def fails(_: object) -> None:
        raise RuntimeError("secret")

    monkeypatch.setattr("ambinav.server.jobs.audit_jobs.started", fails)

    async def many() -> list[Any]:
        audits = Audits(
            ServedMaps(), Limits(audits=1, waiting=1), State(None), lambda: tmp_path, print
        )

        def begin() -> Any:
            plan = Sent("hall.wkt", b"POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0))")
            return audits.begin([plan], "", 0.1, 0.5, None, "me")  # type: ignore[list-item]

        found = await asyncio.gather(*(begin() for _ in range(5)), return_exceptions=True)
        with pytest.raises(InputError):
            await audits.begin([], "", 0.1, 0.5, None, "me")
        begun = [one for one in found if isinstance(one, Audit)]
        async with asyncio.timeout(10.0):
            while any(one.state not in OVER for one in begun):
                await asyncio.sleep(0)
        begun.append(await begin())  # there is a place again
        await asyncio.gather(*(one.job for one in begun if one.job))
        return [*found, *begun[2:]]

    found = asyncio.run(many())
    refused = [one for one in found if isinstance(one, Problem)]
    assert [one.status_code for one in refused] == [503] * 3
    failed = [one for one in found if isinstance(one, Audit)]
    # A fault of the server ends an audit too, and is not told in its words.
    assert [(one.state, one.detail) for one in failed] == [("failed", OURS)] * 3
    assert "secret" in caplog.text
    assert len(list(tmp_path.iterdir())) == 3


def test_a_job_ends_with_the_server_and_says_so() -> None:
    async def stopped() -> None:
        begun, ended = asyncio.Event(), asyncio.Event()

        async def work() -> None:
            begun.set()
            try:
                await asyncio.Event().wait()
            finally:
                ended.set()

        async def receive() -> dict[str, str]:
            await asyncio.Event().wait()
            raise AssertionError

        request = Request({"type": "http"}, receive)  # type: ignore[arg-type]
        task = asyncio.create_task(while_connected(request, work()))
        await begun.wait()
        task.cancel()
        with pytest.raises(Problem, match="shutting down"):
            await task
        async with asyncio.timeout(10.0):
            await ended.wait()

    asyncio.run(stopped())


def _sends_a_part(line: Any) -> None:
    """A worker that is held up within its answer."""
    os.write(line.fileno(), struct.pack("!i", 1000) + b"0" * 500)
    line.recv()


def test_an_answer_that_comes_in_parts_holds_nobody_up() -> None:
    async def interrupted() -> None:
        worker = await started(_sends_a_part)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.0):  # would never come if the loop waited
                await received(worker)
        await asyncio.gather(*(asyncio.to_thread(worker.end) for _ in range(3)))
        worker.kill()

    asyncio.run(asyncio.wait_for(interrupted(), 60.0))
