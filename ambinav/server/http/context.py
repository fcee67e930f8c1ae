"""State shared by all routes of an application."""

from __future__ import annotations

import asyncio
import itertools
import logging
import threading
from collections.abc import Callable, Sequence
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Final, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi import Request

from ambinav.server.http.etag import matches
from ambinav.server.jobs.audit_jobs import Audits
from ambinav.server.jobs.edit_sessions import EditedMap, Edits
from ambinav.server.jobs.plan_archive import PlanJobs
from ambinav.server.jobs.plan_jobs import PlanPool, warm_up_plan
from ambinav.server.jobs.scratch import ScratchFolder
from ambinav.server.jobs.state import State
from ambinav.server.limits import Limits
from ambinav.server.observer import Metrics
from ambinav.server.problems import Problem
from ambinav.server.served import MARK, ServedMap, ServedMaps, digest_of_map
from ambinav.server.tiles.pyramids import Pyramids
from ambinav.server.tiles.render import Tiles
from ambinav.server.warming import Step, Warming, free_pose, load_kernels
from ambinav.server.wire import write_dataset

T = TypeVar("T")

_log = logging.getLogger("ambinav.server")

THREADS: Final = 4
"""In which answers are worked out that would hold up the others."""


class Context:
    """State shared by all routes; created before the event loop runs, closed after it.

    Attributes:
        maps: The maps that are served.
        limits: Limits of requests.
        state: Edits and jobs that outlive the server.
        prefix: Path in front of all addresses, see `Access.prefix`.
        metrics: Figures of requests and jobs.
        warming: Progress of the preparation.
        is_ending: Whether the server ends.
    """

    def __init__(
        self, maps: ServedMaps, limits: Limits, state: State | None = None, prefix: str = ""
    ) -> None:
        self.maps = maps
        self.limits = limits
        self.state = State(None) if state is None else state
        self.prefix = prefix
        self._tiles: dict[ServedMap, Tiles] = {}
        self._files: dict[ServedMap, Path] = {}
        self._results: dict[ServedMap, dict[str, asyncio.Task[Any]]] = {}
        self._numbers = itertools.count()
        self._lock = threading.Lock()
        self.metrics = Metrics()
        self.warming = Warming()
        self.is_ending = False
        for name, text, value in (
            ("maps", "Served maps", lambda: len(self.maps)),
            ("edited_maps", "Edited maps in memory", lambda: len(self.maps.edited)),
            ("ready", "1 if the server is ready", lambda: self.warming.seconds is not None),
            ("plans_running", "Plans that are computed", lambda: self._running("plans")),
            ("edits_running", "Edits that are computed", lambda: self._running("edits")),
            ("audits_running", "Audits that run or wait", lambda: self._running("audits")),
        ):
            self.metrics.gauge(name, text, value)

    def _running(self, kind: str) -> int:
        """Return the number of jobs of a kind, without starting what runs them."""
        jobs = vars(self).get(kind)
        return 0 if jobs is None else jobs.running

    @cached_property
    def plans(self) -> PlanPool:
        """Processes that plan."""
        return PlanPool(self.limits.plans, self.limits.waiting, self.limits.job_seconds)

    @cached_property
    def audits(self) -> Audits:
        """Audits of uploaded maps."""
        return Audits(self.maps, self.limits, self.state, lambda: self.folder, self.forget)

    @cached_property
    def edits(self) -> Edits:
        """Edited maps."""
        return Edits(
            self.maps, self.limits, self._file, lambda: self.folder, self.forget, self.state
        )

    @cached_property
    def _limiter(self) -> CapacityLimiter:
        return CapacityLimiter(THREADS)

    @cached_property
    def _scratch(self) -> ScratchFolder:
        return ScratchFolder()

    @property
    def folder(self) -> Path:
        """Folder that exists as long as the application; it is created if missing."""
        path = self._scratch.path
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        return path

    @cached_property
    def plan_jobs(self) -> PlanJobs:
        """Plans whose results are kept."""
        return PlanJobs(self._map_of, self.plans, self.state, self._file)

    async def _map_of(self, id: str) -> ServedMap:
        is_forgotten = MARK in id and not self.maps.has(id)
        return await self.edits.restored(id) if is_forgotten else self.maps.get(id)

    async def map(self, request: Request, id: str) -> ServedMap:
        """Return the map that a request names; an edited one is computed again if it must be.

        Raises:
            Problem: there is none, or it is not the one of the header `If-Match`.
        """
        served = await self._map_of(id)
        if_match = request.headers.get("if-match")
        if if_match is not None and not matches(
            if_match, f'"{await self.in_thread(digest_of_map, served)}"'
        ):
            raise Problem(
                412, f"The map {served.name!r} is not the one of If-Match; fetch it again."
            )
        return served

    def tiles(self, served: ServedMap) -> Tiles:
        """Return the tiles of a map."""
        tiles = self._tiles.get(served)
        if tiles is None:
            # Those of an edited map have the colours of the original, to be compared.
            like = self.tiles(served.base) if isinstance(served, EditedMap) else None
            tiles = Tiles(served, Pyramids(served.amap, served.path, served.key), like)
            if self.maps.holds(served):
                self._tiles[served] = tiles
        return tiles

    def file_of(self, served: ServedMap) -> Path:
        """Return a map as one file, for workers and clients; it is written if missing.

        Raises:
            Problem: the map is no longer served.
        """
        with self._lock:
            if not self.maps.holds(served):
                raise Problem(404, f"The map {served.name!r} is no longer served.", field="id")
            path = self._files.get(served)
            if path is None or not path.exists():
                path = path or self.folder / f"{next(self._numbers)}.npz"
                path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
                write_dataset(served.amap.dataset, path)
                self._files[served] = path
        return path

    async def _file(self, served: ServedMap) -> Path:
        return await self.in_thread(self.file_of, served)

    async def resume(self) -> None:
        """Go on with the jobs of the last server with the same state."""
        if self.state.folder is not None:
            await self.audits.resume()
            await self.plan_jobs.resume()

    async def prepare(self, first: Sequence[Step], *, processes: bool) -> None:
        """Prepare the first answers of all kinds, so that no request waits for compilation.

        Args:
            first: Further steps.
            processes: Whether to start the processes for plans and edits as well.
        """
        steps: list[Step] = [partial(self.in_thread, load_kernels, served) for served in self.maps]
        steps += [partial(self.in_thread, self._draw, served) for served in self.maps]
        steps += first
        # Maps with headings and those without use other code.
        kinds = {served.amap.has_theta: served for served in self.maps}
        for served in kinds.values() if processes else ():
            steps += [partial(self._plan_once, served), partial(self.edits.find, served, (), None)]
        await self.warming.run(steps)

    def _draw(self, served: ServedMap) -> None:
        """Draw the zones of a map, which the page shows first."""
        tiles = self.tiles(served)
        tiles.png(*tiles.resolve("zone", None), "mean", 0, 0, 0)

    async def _plan_once(self, served: ServedMap) -> None:
        """Plan routes of one cell, so that a process for plans runs and its code is compiled."""
        place = free_pose(served.amap)
        if place is None:
            return
        path = str(await self._file(served))
        for weights in (None, (0.0, 1.0)):
            try:
                await self.plans.run(warm_up_plan(served, path, place, weights))
            except Problem as problem:
                if problem.status_code == 503:
                    raise
                # No robot fits, say; the process has begun all the same.
                _log.warning("plans are not prepared: %s", problem.detail)

    def keep_pyramids(self, stop: threading.Event) -> None:
        """Write the pyramids of all maps into their stores, one after the other."""
        for served in self.maps:
            try:
                self.tiles(served).pyramids.keep(stop)
            except Exception:  # tiles are made without it, and the other maps' are still kept
                _log.exception("the pyramid of %s cannot be kept", served.name)

    def forget(self, served: ServedMap) -> None:
        """Stop serving a map and drop its cached data."""
        if "edits" in vars(self):
            for edited in self.edits.of(served):
                self.forget(edited)
        self.maps.remove(served.name)
        self._tiles.pop(served, None)
        self._results.pop(served, None)
        with self._lock:
            path = self._files.pop(served, None)
        if path is not None:
            path.unlink(missing_ok=True)

    async def in_thread(self, function: Callable[..., T], *arguments: Any) -> T:
        """Run a long call in a thread, so that other requests go on."""
        return await to_thread.run_sync(function, *arguments, limiter=self._limiter)

    async def once(self, served: ServedMap, name: str, work: Callable[[ServedMap], T]) -> T:
        """Compute a result once for each map, in a thread; concurrent callers share the task."""
        results = self._results.setdefault(served, {})
        task = results.get(name)
        if task is None or (task.done() and (task.cancelled() or task.exception())):
            task = results[name] = asyncio.create_task(self.in_thread(work, served))
        try:
            # A caller that is cancelled must not cancel the task for the others.
            result: T = await asyncio.shield(task)
        finally:
            if not self.maps.holds(served):
                self._results.pop(served, None)  # it was forgotten meanwhile
        return result

    def end(self) -> None:
        """Stop being ready."""
        self.is_ending = True

    async def end_audits(self) -> None:
        """Stop all audits and the event streams of their clients."""
        if "audits" in vars(self):
            await self.audits.close()

    async def close(self) -> None:
        """Stop all jobs and remove written files."""
        await self.end_audits()
        vars(self).pop("audits", None)
        if "plan_jobs" in vars(self):
            await self.plan_jobs.close()
            del self.plan_jobs
        for name in ("plans", "edits", "_scratch"):
            if name in vars(self):
                vars(self).pop(name).close()
        self._files.clear()
        self._results.clear()
        vars(self).pop("_limiter", None)


def context_of(request: Request) -> Context:
    """Return the context of a request's application."""
    context = request.app.state.context
    assert isinstance(context, Context)
    return context
