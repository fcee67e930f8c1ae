"""Processes of edits that nobody waits for any more: they take the next edit."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

import ambinav as an
from ambinav.buildings.obstacle_file import DrawnObstacle
from ambinav.server.jobs.edit_sessions import EditPool, Edits
from ambinav.server.jobs.plan_jobs import received
from ambinav.server.jobs.state import State
from ambinav.server.jobs.workers import Worker
from ambinav.server.limits import Limits
from ambinav.server.served import ServedMap, ServedMaps
from tests.server.idle_edits import in_two_parts, until_stopped

POST = DrawnObstacle("post", ((7.0, 1.6),), radius=0.15)
WALL = DrawnObstacle("wall", ((5.0, 1.0), (5.0, 1.6)), thickness=0.1)


@pytest.mark.slow
def test_a_superseded_edit_whose_caller_leaves_keeps_its_process(
    corridor: an.AmbiguityMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EditPool, "work", staticmethod(until_stopped))
    # On a loaded machine a process takes longer to start.
    monkeypatch.setattr("ambinav.server.jobs.edit_sessions.STOP_SECONDS", 120.0)
    maps = ServedMaps()
    base = maps.add(corridor, "map")

    async def file_of(_: ServedMap) -> Path:
        return tmp_path

    left, leave = [], EditPool._can_reuse

    async def noted(pool: EditPool, worker: Worker, answer: asyncio.Future[Any]) -> bool:
        left.append(await leave(pool, worker, answer))
        return left[-1]

    monkeypatch.setattr(EditPool, "_can_reuse", noted)

    async def outcomes() -> list[Any]:
        edits = Edits(maps, Limits(), file_of, lambda: tmp_path, lambda _: None, State(None))
        found = []
        for leaves_first in (True, False):
            first = asyncio.create_task(edits.find(base, (POST,), "session"))
            while not edits.pool.busy:
                await asyncio.sleep(0.01)
            if leaves_first:
                first.cancel()
                await asyncio.sleep(0)
            second = asyncio.create_task(edits.find(base, (WALL,), "session"))
            await asyncio.sleep(0)
            first.cancel()
            found += await asyncio.gather(first, return_exceptions=True)
            second.cancel()
            await asyncio.gather(second, return_exceptions=True)
            async with asyncio.timeout(60.0):
                while edits.pool.busy:
                    await asyncio.sleep(0.01)
        edits.close()
        return found

    for outcome in asyncio.run(outcomes()):
        assert isinstance(outcome, asyncio.CancelledError)
    assert left and all(left)


def test_who_waits_for_a_process_when_the_server_ends_is_only_cancelled() -> None:
    async def outcome() -> Any:
        worker = await asyncio.to_thread(Worker, until_stopped)
        waiting = asyncio.create_task(received(worker))
        await asyncio.sleep(0.05)
        worker.end()
        waiting.cancel()
        (found,) = await asyncio.gather(waiting, return_exceptions=True)
        return found

    assert isinstance(asyncio.run(outcome()), asyncio.CancelledError)


@pytest.mark.slow
def test_an_edit_that_is_left_while_its_answer_is_read_keeps_its_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(EditPool, "work", staticmethod(in_two_parts))

    async def processes() -> set[int | None]:
        pool, found = EditPool(1, 1, 60.0), set()
        for number in range(2):
            begun = tmp_path / f"{number}"
            edit = asyncio.create_task(pool.run(begun))
            while not begun.exists():
                await asyncio.sleep(0.01)
            await asyncio.sleep(0.1)  # it is being read by now
            (worker,) = pool.busy
            edit.cancel()
            with pytest.raises(asyncio.CancelledError):
                await asyncio.wait_for(edit, 60.0)
            found.add(worker.process.pid)
            assert worker.process.is_alive()
        pool.close()
        return found

    assert len(asyncio.run(processes())) == 1
