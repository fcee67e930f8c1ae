"""Plans that run without a waiting client, and whose results are kept."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import secrets
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeVar

from ambinav.server.jobs.plan_jobs import PlanPool
from ambinav.server.jobs.state import CUT_OFF, State
from ambinav.server.jobs.workers import PlanTask
from ambinav.server.problems import RETRY, Problem, sentence_of, too_many
from ambinav.server.served import ServedMap, digest_of_map

T = TypeVar("T")
PlanState = Literal["waiting", "done", "failed"]
KIND: Final = "plan"
RETRY_SECONDS: Final = 2.0
"""Seconds after which an accepted plan asks again for a place among those of waiting clients."""
MOST_WAITING: Final = 200
"""Plans that wait, of all clients."""


class PlanJob(NamedTuple):
    """A plan that was asked for.

    Attributes:
        id: Random: who knows it may see it.
        map: Id of its map.
        state: State of the plan; "waiting" until it has ended.
        routes: What `plan` or `pareto` answers, when it is done.
        detail: Why it failed.
    """

    id: str
    map: str
    state: PlanState
    routes: Any
    detail: str | None


class PlanJobs:
    """All plans of an application that are kept; those that were cut off are planned again.

    Args:
        map_of: Returns the map of an id; an edited one is computed again if it must be.
        pool: Processes that plan.
        state: Keeps tasks and results.
        file_of: Writes a map as a file for workers.
    """

    def __init__(
        self,
        map_of: Callable[[str], Awaitable[ServedMap]],
        pool: PlanPool,
        state: State,
        file_of: Callable[[ServedMap], Awaitable[Path]],
    ) -> None:
        self._map_of = map_of
        self._pool = pool
        self._state = state
        self._file_of = file_of
        self._turn = asyncio.Lock()
        self._running: dict[str, tuple[str, asyncio.Task[None]]] = {}

    async def begin(self, served: ServedMap, task: PlanTask, client: str, most: int) -> PlanJob:
        """Keep a plan and start it.

        Args:
            served: Its map.
            task: The task; its `map_file` does not matter.
            client: Address of the client.
            most: Plans of the client that may wait.

        Raises:
            Problem: the client has too many.
        """
        digest = await asyncio.to_thread(digest_of_map, served)
        # From here on nothing waits: others that ask meanwhile are counted.
        if sum(owner == client for owner, _ in self._running.values()) >= most:
            raise too_many(client, most, "plans")
        if len(self._running) >= MOST_WAITING:
            raise Problem(503, "Too many plans are waiting; try again later.", headers=RETRY)
        id = secrets.token_urlsafe(12)
        self._state.keep_job(id, KIND, {**dataclasses.asdict(task), "digest": digest})
        self._start(id, digest, task, client)
        return self.get(id)

    def get(self, id: str) -> PlanJob:
        """Return a plan.

        Raises:
            Problem: there is none of that id, or no longer.
        """
        stored = self._state.job(id, KIND)
        if stored is None:
            raise Problem(404, "There is no such plan, or it is no longer kept.", field="id")
        task, state, result = stored
        done = state == "done" and result is not None
        return PlanJob(
            id=id,
            map=task["map_name"],
            state=state,  # type: ignore[arg-type]  # as `end_job` was given it
            routes=json.loads(result) if done and result else None,
            detail=None if done else result,
        )

    def cancel(self, id: str) -> None:
        """Stop a plan if it still runs, and delete it."""
        self.get(id)
        if id in self._running:
            self._running[id][1].cancel()
        self._state.drop_job(id)

    async def resume(self) -> None:
        """Start the plans that were cut off."""
        for id, plain, state, _ in self._state.jobs(KIND):
            if state != "waiting" or id in self._running:
                continue
            if not self._state.may_start(id):
                await self._state.job_ended(id, "failed", CUT_OFF)
                continue
            digest = plain.pop("digest")
            task = PlanTask(**{key: _as_tuple(value) for key, value in plain.items()})
            self._start(id, digest, task, "")

    def _start(self, id: str, digest: str, task: PlanTask, client: str) -> None:
        job = asyncio.create_task(self._run(id, digest, task))
        self._running[id] = client, job
        job.add_done_callback(lambda _: self._running.pop(id, None))

    async def _run(self, id: str, digest: str, task: PlanTask) -> None:
        try:
            # One at a time, so that clients that wait for their plans find a place.
            async with self._turn:
                served = await _retry_while_full(lambda: self._map_of(task.map_name))
                if await asyncio.to_thread(digest_of_map, served) != digest:
                    raise Problem(
                        412, f"The map {task.map_name!r} is another one since the last start."
                    )
                path = await self._file_of(served)
                self._state.count_start(id)
                local_task = dataclasses.replace(task, map_file=str(path))
                routes = await _retry_while_full(lambda: self._pool.run(local_task))
        except Problem as problem:
            await self._state.job_ended(id, "failed", str(problem.detail))
        except Exception as error:
            await self._state.job_ended(id, "failed", sentence_of(error, "a plan"))
        else:
            await self._state.job_ended(id, "done", json.dumps(routes))

    async def close(self) -> None:
        """Stop all plans; they are resumed by the next server with the same state."""
        jobs = [job for _, job in self._running.values()]
        for job in jobs:
            job.cancel()
        await asyncio.gather(*jobs, return_exceptions=True)


async def _retry_while_full(call: Callable[[], Awaitable[T]]) -> T:
    """Return what a call gives, tried again as long as too many others are waiting."""
    while True:
        try:
            return await call()
        except Problem as problem:
            if problem.status_code != 503 or problem.headers != RETRY:
                raise
        await asyncio.sleep(RETRY_SECONDS)


def _as_tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value
