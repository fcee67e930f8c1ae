"""Uploads of maps, and their audits in processes of their own."""

from __future__ import annotations

import asyncio
import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import ambinav as an
from ambinav.runtime.errors import InputError
from ambinav.server.jobs.audit_jobs import ENDED, Audit, Audits
from ambinav.server.jobs.state import State
from ambinav.server.jobs.uploads import store
from ambinav.server.jobs.workers import AuditTask, _check_size
from ambinav.server.limits import Limits
from ambinav.server.problems import OURS, Problem
from ambinav.server.served import ServedMaps
from tests.server.live import Live


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
            "/v1/audits", files=[("files", ("a.geojson", content))], data={"scanner": "sick-lms200"}
        )
        name, data = events(live.http.get(f"{answer.headers['location']}/events").text)[-1]
        assert name == "failed" and message in data["detail"]
        assert "/tmp" not in data["detail"]
        assert live.http.get(f"{answer.headers['location']}/report").status_code == 409


@pytest.mark.sweep
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


@pytest.mark.slow
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
    task = AuditTask("", spacing=1.0, radius=0.5, cells=100)
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
            return audits.begin([plan], AuditTask("", 0.1, 0.5), "me")  # type: ignore[list-item]

        found = await asyncio.gather(*(begin() for _ in range(5)), return_exceptions=True)
        with pytest.raises(InputError):
            await audits.begin([], AuditTask("", 0.1, 0.5), "me")
        begun = [one for one in found if isinstance(one, Audit)]
        async with asyncio.timeout(10.0):
            while any(one.state not in ENDED for one in begun):
                await asyncio.sleep(0)
        begun.append(await begin())  # there is a place again
        await asyncio.gather(*(one.job for one in begun if one.job))
        return [*found, *begun[2:]]

    found = asyncio.run(many())
    refused = [one for one in found if isinstance(one, Problem)]
    assert [one.status_code for one in refused] == [503] * 3
    failed = [one for one in found if isinstance(one, Audit)]
    # A fault of the server ends an audit too; the message is not in its words.
    assert [(one.state, one.detail) for one in failed] == [("failed", OURS)] * 3
    assert "secret" in caplog.text
    assert len(list(tmp_path.iterdir())) == 3


def test_only_so_many_finished_audits_are_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fails(_: object) -> None:
        raise RuntimeError

    monkeypatch.setattr("ambinav.server.jobs.audit_jobs.started", fails)
    limits = Limits(audits=1, waiting=3, kept_audits=2)

    async def some() -> list[Audit]:
        audits = Audits(ServedMaps(), limits, State(None), lambda: tmp_path, print)
        begun = []
        for _ in range(5):
            plan = Sent("hall.wkt", b"POLYGON ((0 0, 5 0, 5 5, 0 5, 0 0))")
            begun.append(await audits.begin([plan], AuditTask("", 0.1, 0.5), "me"))  # type: ignore[list-item]
            assert begun[-1].job is not None
            await begun[-1].job
        assert [audits.get(one.id) for one in begun[-2:]] == begun[-2:]
        for one in begun[:-2]:
            with pytest.raises(Problem, match="no longer kept"):
                audits.get(one.id)
        return begun

    begun = asyncio.run(some())
    assert {path.name for path in tmp_path.iterdir()} == {one.folder.name for one in begun[-2:]}
