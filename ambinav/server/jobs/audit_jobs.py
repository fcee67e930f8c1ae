"""Audits of uploaded maps: jobs with progress, whose maps are then served."""

from __future__ import annotations

import asyncio
import secrets
import shutil
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from starlette.datastructures import UploadFile

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import disk_is_full
from ambinav.server.jobs.plan_jobs import Turns, received, started
from ambinav.server.jobs.state import CUT_OFF, State
from ambinav.server.jobs.uploads import store
from ambinav.server.jobs.workers import AuditTask, Failure, audits
from ambinav.server.limits import Limits
from ambinav.server.problems import ENDING, RETRY, Problem, sentence_of, too_many
from ambinav.server.served import ServedMap, ServedMaps
from ambinav.server.wire import read_map

AuditState = Literal["waiting", "running", "done", "failed", "cancelled"]
ENDED: Final = ("done", "failed", "cancelled")
KIND: Final = "audit"
MAP: Final = "map.npz"
"""Ambiguity map in the folder of an audit."""
KILLED: Final = "The audit's process was killed, perhaps for lack of memory."


@dataclass(eq=False)
class Audit:
    """A requested audit.

    Attributes:
        id: Random: who knows it may see it.
        folder: Its files.
        client: Address of the client that asked for it.
        state: State of the audit.
        stage: Current stage: "read", "map" or "report".
        done: Share done of the stage, 0 to 1.
        detail: Why it failed.
        served: Its map.
        changed: Set and replaced whenever anything changes.
        job: The task that runs it.
    """

    id: str
    folder: Path
    client: str
    state: AuditState = "waiting"
    stage: str = "waiting"
    done: float = 0.0
    detail: str | None = None
    served: ServedMap | None = None
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    job: asyncio.Task[None] | None = None

    @property
    def report(self) -> Path:
        """Path of its report, a single HTML file."""
        return self.folder / "report" / "report.html"

    def change(self, **values: Any) -> None:
        """Update the state and notify waiting clients."""
        for name, value in values.items():
            setattr(self, name, value)
        self.changed.set()
        self.changed = asyncio.Event()


class Audits:
    """All audits of an application; the oldest finished ones are dropped when there are too many.

    Args:
        maps: The served maps.
        limits: Limits of number and time.
        state: Keeps audits; where it has a folder, so do they in it.
        folder: Gives that of the application; otherwise each audit gets one in that.
        forget: Called with a map that is no longer served.
    """

    def __init__(
        self,
        maps: ServedMaps,
        limits: Limits,
        state: State,
        folder: Callable[[], Path],
        forget: Callable[[ServedMap], None],
    ) -> None:
        self._maps = maps
        self._limits = limits
        self._state = state
        self._folder = folder
        self._forget = forget
        self._turns = Turns(limits.audits, limits.waiting, "audits")
        self._all: dict[str, Audit] = {}
        self._closed = False

    def get(self, id: str) -> Audit:
        """Return an audit.

        Raises:
            Problem: there is none of that id, or no longer.
        """
        audit = self._all.get(id)
        if audit is None:
            raise Problem(404, "There is no such audit, or it is no longer kept.", field="id")
        return audit

    @property
    def running(self) -> int:
        """Number of audits that run or wait."""
        return sum(audit.state not in ENDED for audit in self._all.values())

    async def begin(self, files: Sequence[UploadFile], task: AuditTask, client: str) -> Audit:
        """Store an upload and start its audit.

        Args:
            files: The upload.
            task: The task without what follows from the upload.
            client: Address of the client.

        Raises:
            InputError: the files are not those of one map.
            Problem: too many audits wait, or the server ends.
        """
        if self._closed:
            raise Problem(503, ENDING)
        limits = self._limits
        if self.running >= limits.audits + limits.waiting:
            raise Problem(503, "Too many audits are waiting; try again later.", headers=RETRY)
        theirs = [a for a in self._all.values() if a.client == client and a.state not in ENDED]
        if len(theirs) >= limits.client_jobs:
            raise too_many(client, limits.client_jobs, "audits")
        parent = self._folder() if self._state.folder is None else self._state.folder
        folder = Path(tempfile.mkdtemp(prefix="audit-", dir=parent))
        audit = Audit(secrets.token_urlsafe(12), folder, client)
        self._all[audit.id] = audit  # counts from now on: others ask while the files are stored
        try:
            upload = await asyncio.to_thread(store, files, folder)
            if self._closed:
                raise Problem(503, ENDING)
            task = replace(
                task, folder=str(folder), map_name=upload.file, title=upload.title,
                cells=limits.audit_cells,
            )  # fmt: skip
            record = {**asdict(task), "folder": folder.name, "client": client}
            self._state.keep_job(audit.id, KIND, record)
        except BaseException:
            self._drop(audit)
            raise
        audit.job = asyncio.create_task(self._run(audit, task))
        return audit

    async def resume(self) -> None:
        """Serve the maps of finished audits again, and run those again that were cut off."""
        folder = self._state.folder
        assert folder is not None
        folders = {plain["folder"] for _, plain, _, _ in self._state.jobs(KIND)}
        for left in folder.glob("audit-*"):  # of uploads that were cut off before they counted
            if left.name not in folders:
                await asyncio.to_thread(shutil.rmtree, left, ignore_errors=True)
        for id, plain, state, result in self._state.jobs(KIND):
            if id in self._all:
                continue
            client, place = plain.pop("client"), folder / plain["folder"]
            audit = self._all[id] = Audit(id, place, client)
            if state == "failed":
                audit.change(state="failed", detail=result)
            elif state == "done":
                try:
                    amap = await asyncio.to_thread(read_map, place / MAP, plain["title"])
                except (InputError, OSError) as error:
                    await self._failed(audit, f"Its map can no longer be read: {error}")
                    continue
                title = plain["title"]
                served = self._maps.add(amap, result or title, title=title)
                audit.change(state="done", stage="report", done=1.0, served=served)
            elif self._state.may_start(id):
                task = AuditTask(**{**plain, "folder": str(place)})
                audit.job = asyncio.create_task(self._run(audit, task))
            else:
                await self._failed(audit, CUT_OFF)

    async def cancel(self, audit: Audit) -> None:
        """Stop an audit if it still runs, and delete it with its map."""
        await _stop_all([audit], "The audit was cancelled.")
        self._drop(audit)

    async def close(self) -> None:
        """Stop all audits and refuse new ones; the application's folder removes their files."""
        self._closed = True
        await _stop_all(list(self._all.values()), ENDING)

    async def _run(self, audit: Audit, task: AuditTask) -> None:
        try:
            async with self._turns:
                self._state.count_start(audit.id)
                audit.change(state="running", stage="read")
                worker = await started(audits)
                try:
                    worker.line.send(task)
                    async with asyncio.timeout(self._limits.audit_seconds):
                        while isinstance(news := await received(worker), tuple):
                            audit.change(stage=news[0], done=news[1])
                finally:
                    await asyncio.to_thread(worker.end)
            if isinstance(news, Failure):
                if news.ours:
                    raise news.error
                return await self._failed(audit, news.detail)
            amap = await asyncio.to_thread(read_map, audit.folder / MAP, task.title)
            served = self._maps.add(amap, task.title)
            await self._state.job_ended(audit.id, "done", served.name)
            audit.change(state="done", stage="report", done=1.0, served=served)
            self._forget_old()
        except asyncio.CancelledError:
            raise  # `_stop_all` tells who follows
        except TimeoutError:
            limit = self._limits.audit_seconds
            await self._failed(audit, f"The audit was stopped after {limit:g} s.")
        except Exception as error:
            killed = isinstance(error, EOFError | OSError) and not disk_is_full(error)
            await self._failed(audit, KILLED if killed else sentence_of(error, "an audit"))

    async def _failed(self, audit: Audit, detail: str) -> None:
        await self._state.job_ended(audit.id, "failed", detail)
        audit.change(state="failed", detail=detail)
        self._forget_old()

    def _forget_old(self) -> None:
        over = [audit for audit in self._all.values() if audit.state in ENDED]
        for audit in over[: -self._limits.kept_audits or None]:
            self._drop(audit)

    def _drop(self, audit: Audit) -> None:
        self._all.pop(audit.id, None)
        if audit.served is not None:
            self._forget(audit.served)
        shutil.rmtree(audit.folder, ignore_errors=True)  # first, as the disk may be full
        self._state.drop_job(audit.id)


async def _stop_all(audits: Sequence[Audit], why: str) -> None:
    """Stop running audits and wait until their processes have ended."""
    jobs = [audit.job for audit in audits if audit.job is not None]
    for job in jobs:
        job.cancel()
    await asyncio.gather(*jobs, return_exceptions=True)
    for audit in audits:
        if audit.state not in ENDED:
            audit.change(state="cancelled", detail=why)
