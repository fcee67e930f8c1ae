"""Edits, sessions, plans and audits that outlive the server."""

from __future__ import annotations

import errno
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from typer.testing import CliRunner

import ambinav as an
from ambinav.cli import app
from ambinav.server.http.app import create_app
from ambinav.server.jobs.state import FILE, MOST_STARTS, StaleStepError, State
from tests.server.live import Live, running
from tests.server.test_cli_serve import started

SESSION = "/v1/maps/map/sessions/mine"
PLAN = b'{"type": "Polygon", "coordinates": [[[0,0],[9,0],[9,3],[0,3],[0,0]]]}'


def post_at(x: float) -> dict[str, Any]:
    """Return a post as an edit."""
    feature = {
        "type": "Feature",
        "properties": {"kind": "post", "radius": 0.1},
        "geometry": {"type": "Point", "coordinates": [x, 1.0]},
    }
    return {"type": "FeatureCollection", "features": [feature]}


def edit(live: Live, x: float, **query: Any) -> str:
    """Edit the map in the session, and return the id of the result."""
    answer = live.http.post(
        "/v1/maps/map/edits", params={"session": "mine", **query}, json=post_at(x)
    )
    assert answer.status_code == 200, answer.text
    return str(answer.json()["id"])


def test_a_session_is_undone_and_redone(live: Live) -> None:
    assert live.get(SESSION)["steps"] == []
    ids = [edit(live, x) for x in (1.0, 1.2, 1.4)]
    assert edit(live, 1.4) == ids[2]  # the same again is no step
    edit(live, 1.6, draft=True)
    found = live.get(SESSION)
    assert [step["map"] for step in found["steps"]] == ids
    assert (found["position"], found["current"], found["map"]) == (3, ids[2], "map")

    def move(what: str) -> str:
        answer = live.http.post(f"{SESSION}/{what}")
        assert answer.status_code == 200, answer.text
        return str(answer.json()["id"])

    assert [move("undo") for _ in range(3)] == [ids[1], ids[0], "map"]
    assert live.http.post(f"{SESSION}/undo").status_code == 409
    assert [move("redo") for _ in range(2)] == ids[:2]
    other = edit(live, 1.8)  # in place of what was undone
    assert [step["map"] for step in live.get(SESSION)["steps"]] == [*ids[:2], other]
    assert live.http.post(f"{SESSION}/redo").status_code == 409
    assert live.http.post(f"/v1/maps/{other}/sessions/mine/undo").status_code == 422
    assert live.http.delete(SESSION).status_code == 204
    assert live.get(SESSION)["position"] == 0


def test_an_edit_says_which_step_it_goes_on_from(live: Live) -> None:
    def post(x: float, **query: Any) -> Any:
        query = {"session": "both", **query}
        return live.http.post("/v1/maps/map/edits", params=query, json=post_at(x))

    assert post(2.0, after=0).json()["step"] == 1
    assert post(2.2, after=1).json()["step"] == 2
    late = post(2.4, after=1)
    assert late.status_code == 409 and late.json()["field"] == "after"
    assert "at step 2 meanwhile" in late.json()["detail"]
    assert post(2.2, after=2).json()["step"] == 2  # the same again is no step
    assert post(2.4, draft=True).json()["step"] is None
    undone = live.http.post("/v1/maps/map/sessions/both/undo").json()
    assert undone["step"] == 1
    assert post(2.6, after=2).status_code == 409
    assert post(2.6, after=-1).status_code == 422
    assert post(2.6).json()["step"] == 2  # who does not ask is not refused
    nothing = {"type": "FeatureCollection", "features": []}
    query = {"session": "both", "after": 2}
    removed = live.http.post("/v1/maps/map/edits", params=query, json=nothing).json()
    assert (removed["step"], removed["id"], removed["obstacles"]) == (3, "map", 0)
    assert live.get("/v1/maps/map/sessions/both")["current"] == "map"
    assert live.http.post("/v1/maps/map/sessions/both/undo").json()["obstacles"] == 1
    none = live.http.post("/v1/maps/map/edits", json=post_at(2.6)).json()
    assert none["step"] is None


def test_of_two_edits_from_one_step_one_is_kept(tmp_path: Path) -> None:
    state = State(tmp_path)
    assert state.keep_edit("map--a", "map", "{}", "s", after=0) == 1
    with pytest.raises(StaleStepError):
        state.keep_edit("map--b", "map", "{}", "s", after=0)
    assert [name for _, name, *_ in state.steps("s", "map")[1]] == ["map--a"]
    assert state.obstacles_of("map--b") is None
    # Who has not heard of its own last step may go on all the same.
    assert state.keep_edit("map--c", "map", "{}", "s", after=1, editor="me") == 2
    assert state.keep_edit("map--d", "map", "{}", "s", after=1, editor="me") == 3
    with pytest.raises(StaleStepError):
        state.check_step(1, "you", "s", "map")
    state.move("s", "map", 3, 2, "map--c")  # somebody else undoes the last step of mine
    with pytest.raises(StaleStepError):
        state.check_step(3, "me", "s", "map")
    assert state.keep_edit("map--e", "map", "{}", "s", after=2, editor="me") == 3
    state.close()


def test_an_undo_does_not_undo_what_came_meanwhile(tmp_path: Path) -> None:
    """Each moves from the step that it has seen, to the map that it has found."""
    state = State(tmp_path)
    for step, name in enumerate(("map--a", "map--b", "map--c"), start=1):
        assert state.keep_edit(name, "map", "{}", "s") == step
    state.move("s", "map", 3, 2, "map--b")
    with pytest.raises(StaleStepError):
        state.move("s", "map", 3, 2, "map--b")  # the same undo, asked for twice at once
    assert state.keep_edit("map--d", "map", "{}", "s", after=2) == 3
    with pytest.raises(StaleStepError):
        state.move("s", "map", 2, 1, "map--a")  # an undo that had begun before the edit
    with pytest.raises(StaleStepError):
        state.move("s", "map", 3, 2, "map--x")
    assert state.steps("s", "map")[0] == 3
    state.move("s", "map", 3, 2, "map--b")
    state.move("s", "map", 2, 1, "map--a")
    state.move("s", "map", 1, 0, "map")
    state.delete_session("s", "map")
    with pytest.raises(StaleStepError):
        state.move("s", "map", 1, 0, "map")
    state.close()


@pytest.mark.slow
def test_what_was_confirmed_is_there_at_the_next_start(plan_map: Path, tmp_path: Path) -> None:
    state = tmp_path / "state"
    with running(create_app([plan_map], state=state)) as live:
        first, second = edit(live, 1.0), edit(live, 1.4)
        before = live.get(f"/v1/maps/{second}")["figures"]
        with pytest.raises(an.InputError, match="in use by another server"):
            State(state)
    with running(create_app([plan_map], state=state)) as live:
        assert live.get(SESSION)["current"] == second
        assert live.get(f"/v1/maps/{second}")["figures"] == before  # computed again
        assert live.http.post(f"{SESSION}/undo").json()["id"] == first
        assert live.http.get("/v1/maps/map--0123456789abcdef").status_code == 404


@pytest.mark.slow
def test_jobs_go_on_after_a_kill(plan_map: Path, tmp_path: Path) -> None:
    state = tmp_path / "state"
    options = (str(plan_map), "--port", "0", "--state", str(state))
    ends = {"start": [1, 1], "goal": [10, 2], "planner": "rrtstar", "time_s": 1.0, "seed": 1}
    with started(*options) as (process, url), httpx.Client(base_url=url, timeout=120.0) as http:
        edited = http.post("/v1/maps/map/edits", json=post_at(5.0)).json()["id"]
        of_edited = http.post(f"/v1/maps/{edited}/plans", json=ends).headers["location"]
        plan = http.post("/v1/maps/map/plans", json=ends)
        assert plan.status_code == 202, plan.text
        front = http.post("/v1/maps/map/plans", json={**ends, "weights": [0.0, 5.0]})
        audits = [
            http.post(
                "/v1/audits",
                files=[("files", ("room.geojson", PLAN))],
                data={"scanner": "sick-lms200", "spacing": "0.5"},
            ).headers["location"]
            for _ in range(3)
        ]
        assert http.delete(audits.pop()).status_code == 204
        process.kill()
        process.wait(30)
    (state / "audit-left").mkdir()  # of an upload that was cut off
    with started(*options) as (process, url), httpx.Client(base_url=url, timeout=120.0) as http:
        assert not (state / "audit-left").exists()
        found = ended(http, plan.headers["location"])
        assert found["state"] == "done" and found["route"]["length"] > 9.0, found
        routes = ended(http, front.headers["location"])
        assert routes["route"] is None and [each["weight"] for each in routes["front"]] == [0, 5]
        of_edit = ended(http, of_edited)  # whose map is computed again
        assert of_edit["state"] == "done", of_edit
        audit, another = (ended(http, place) for place in audits)
        assert audit["state"] == another["state"] == "done", (audit, another)
        maps = [http.get(f"/v1/maps/{each['map']}").json() for each in (audit, another)]
        # Of one file: each has a name of its own, and the file's as title.
        assert len({each["id"] for each in maps}) == 2
        assert {each["name"] for each in maps} == {"room"}
        process.kill()
        process.wait(30)
    with started(*options) as (process, url), httpx.Client(base_url=url, timeout=120.0) as http:
        assert http.get(plan.headers["location"]).json() == found
        assert http.get(audits[0]).json() == audit
        assert maps == [http.get(f"/v1/maps/{each['map']}").json() for each in (audit, another)]
        assert "<html" in http.get(audit["report"]).text
        assert http.delete(plan.headers["location"]).status_code == 204
        assert http.get(plan.headers["location"]).status_code == 404


def ended(http: httpx.Client, place: str) -> dict[str, Any]:
    """Wait for the end of a job."""
    end = time.monotonic() + 120.0
    while True:
        found: dict[str, Any] = http.get(place).json()
        if found["state"] in ("done", "failed"):
            return found
        assert time.monotonic() < end, found
        time.sleep(0.1)


def test_a_job_that_ends_its_server_is_not_started_for_ever(tmp_path: Path) -> None:
    state = State(tmp_path)
    state.keep_job("a", "plan", {"map_name": "map"})
    for _ in range(MOST_STARTS):
        assert state.may_start("a")
        state.count_start("a")
    assert not state.may_start("a")
    state.close()
    again = State(tmp_path)
    assert again.jobs("plan") == [("a", {"map_name": "map"}, "waiting", None)]
    again.close()


def test_a_folder_that_is_no_state_is_refused(
    tmp_path: Path, plan_folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def said(folder: Path) -> str:
        command = ["serve", "map.zarr", "--port", "0", "--state", str(folder)]
        result = CliRunner().invoke(app, command)
        assert result.exit_code == 2
        return " ".join(result.stderr.split())

    (tmp_path / FILE).write_bytes(b"no database" * 100)
    assert f"--state: {tmp_path} cannot be used (file is not a database)" in said(tmp_path)
    newer = tmp_path / "newer"
    newer.mkdir()
    with sqlite3.connect(newer / FILE) as data:
        data.execute("PRAGMA user_version = 99")
    data.close()
    assert "has format 99" in said(newer)
    (tmp_path / "file").write_text("")
    assert "cannot be used" in said(tmp_path / "file")


def test_a_map_is_named_by_its_digest(
    serve: Callable[..., Live], corridor: an.AmbiguityMap, turning: an.AmbiguityMap
) -> None:
    live = serve([corridor, turning])
    path = "/v1/maps/environment"
    answer = live.http.get(path)
    digest = answer.json()["digest"]
    assert answer.headers["etag"] == f'"{digest}"'
    assert live.http.get(f"{path}/map.npz").headers["etag"] == f'"{digest}"'
    known = live.http.get(f"{path}/map.npz", headers={"if-none-match": f'"{digest}"'})
    assert (known.status_code, known.content) == (304, b"")
    at = {"x": 1.0, "y": 1.0}
    for tag, status in (
        (f'"{digest}"', 200), (f'"other", "{digest}"', 200), ("*", 200),
        ('"other"', 412), (f'W/"{digest}"', 412),
    ):  # fmt: skip
        headers = {"if-match": tag}
        assert live.http.get(f"{path}/cost", params=at, headers=headers).status_code == status
    digests = {entry["digest"] for entry in live.get("/v1/maps")["maps"]}
    assert len(digests) == 2 and digest in digests


@pytest.mark.slow
def test_a_full_disk_is_said_and_harms_nothing_that_is_kept(
    plan_map: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with running(create_app([plan_map], state=tmp_path)) as live:
        first = edit(live, 1.0)
        data = live.context.state._data
        (pages,) = data.execute("PRAGMA page_count").fetchone()
        data.execute(f"PRAGMA max_page_count = {pages}")  # as on a full disk
        statuses = set()
        for x in (1.2, 1.25, 1.3, 1.35, 1.4, 1.45, 1.5, 1.55):
            long = post_at(x) | {"features": post_at(x)["features"] * 20}
            answer = live.http.post("/v1/maps/map/edits?session=mine", json=long)
            statuses.add(answer.status_code)
        assert statuses == {507} or statuses == {200, 507}
        assert answer.json()["detail"].startswith("The disk of the server is full")
        assert live.get("/v1/maps/map/cost", x=1.0, y=1.0)["cost"] >= 1.0
        kept = [step["map"] for step in live.get(SESSION)["steps"]]
        assert kept[0] == first
        data.execute("PRAGMA max_page_count = 100000")
        last = edit(live, 1.6)
        monkeypatch.setattr("ambinav.server.jobs.audit_jobs.store", refused)
        answer = live.http.post(
            "/v1/audits", files=[("files", ("a.wkt", b"-"))], data={"scanner": "rplidar-a1"}
        )
        assert answer.status_code == 507
        assert not list(tmp_path.glob("audit-*"))
        assert live.context.audits.running == 0
    with running(create_app([plan_map], state=tmp_path)) as live:
        assert [step["map"] for step in live.get(SESSION)["steps"]] == [*kept, last]


def test_a_job_that_meets_a_full_disk_fails_and_its_end_waits_for_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise sqlite3.OperationalError("database or disk is full")

    end_job, refused = State.end_job, []

    def ended(state: State, *values: Any) -> None:
        if len(refused) < 2:
            refused.append(values)
            full()
        end_job(state, *values)

    monkeypatch.setattr("ambinav.server.jobs.state.DISK_RETRY_SECONDS", 0.05)
    monkeypatch.setattr(State, "count_start", full)
    monkeypatch.setattr(State, "end_job", ended)
    with running(create_app([], state=tmp_path)) as live:
        files = [("files", ("a.wkt", b"POLYGON ((0 0, 9 0, 9 3, 0 3, 0 0))"))]
        answer = live.http.post("/v1/audits", files=files, data={"scanner": "rplidar-a1"})
        events = live.http.get(f"{answer.headers['location']}/events").text
        assert "event: failed" in events and "The disk of the server is full" in events
        assert len(refused) == 2
        ((_, _, state, detail),) = live.context.state.jobs("audit")
        assert state == "failed" and detail.startswith("The disk of the server is full")
