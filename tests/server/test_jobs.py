"""Plans in processes of their own."""

from __future__ import annotations

import asyncio
import json
import os
import shutil
import socket
import struct
import time
from multiprocessing import active_children
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from starlette.requests import Request

import ambinav as an
from ambinav.server.jobs import plan_archive, plan_jobs
from ambinav.server.jobs.plan_jobs import PlanPool, Turns, received, started, while_connected
from ambinav.server.jobs.workers import plans
from ambinav.server.limits import Limits
from ambinav.server.problems import RETRY, Problem
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


@pytest.mark.sweep
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


def test_a_plan_that_is_given_up_while_its_worker_begins_leaves_no_process() -> None:
    async def given_up() -> None:
        before = set(active_children())
        task = asyncio.create_task(started(plans))
        await asyncio.sleep(0)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await asyncio.to_thread(wait_until, lambda: set(active_children()) <= before)

    asyncio.run(given_up())


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


def _sleeps(line: Any) -> None:
    """A worker whose tasks are seconds."""
    while True:
        seconds = line.recv()
        time.sleep(seconds)
        line.send(seconds)


class _Sleepers(PlanPool):
    work = staticmethod(_sleeps)


@pytest.mark.sweep
def test_a_plan_that_ends_soon_keeps_its_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plan_jobs, "GRACE_SECONDS", 0.5)

    async def left(seconds: float) -> bool:
        pool = _Sleepers(1, 1, 60.0)
        try:
            await pool.run(0.0)
            before = pool._idle[:]
            task = asyncio.create_task(pool.run(seconds))
            await asyncio.sleep(0.05)
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            return pool._idle == before
        finally:
            pool.close()

    assert asyncio.run(left(0.2)) and not asyncio.run(left(30.0))


@pytest.mark.slow
def test_an_answer_that_comes_in_parts_holds_nobody_up() -> None:
    async def interrupted() -> None:
        worker = await started(_sends_a_part)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(1.0):  # would never come if the loop waited
                await received(worker)
        await asyncio.gather(*(asyncio.to_thread(worker.end) for _ in range(3)))
        worker.kill()

    asyncio.run(asyncio.wait_for(interrupted(), 60.0))


def test_an_accepted_plan_waits_for_a_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """What others are waiting for ends it no more than it ends a plan that nobody waits for."""
    monkeypatch.setattr(plan_archive, "RETRY_SECONDS", 0.001)
    refusals = [
        Problem(503, "Too many plans are waiting; try again later.", headers=RETRY),
        Problem(503, "Too many plans are waiting; try again later.", headers=RETRY),
    ]

    async def plan() -> str:
        if refusals:
            raise refusals.pop()
        return "planned"

    assert asyncio.run(plan_archive._retry_while_full(plan)) == "planned"
    refusals.append(Problem(503, "The process ended."))
    with pytest.raises(Problem, match="ended"):
        asyncio.run(plan_archive._retry_while_full(plan))
