"""Edited maps: maps of the building with additional obstacles.

Each is served beside the original, under a name made of the original's and of a digest of the
obstacles: whoever asks for the same ones gets the same map, and what was forgotten comes back
under its old name when it is asked for again.
"""

from __future__ import annotations

import asyncio
import hashlib
import itertools
import json
from collections import Counter
from collections.abc import Awaitable, Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

from pydantic_core import to_json

from ambinav.buildings.obstacle_file import DrawnObstacle, collection, obstacles_of
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server.jobs.plan_jobs import PlanPool
from ambinav.server.jobs.state import StaleStepError, State
from ambinav.server.jobs.workers import EditTask, Worker, edits
from ambinav.server.limits import Limits
from ambinav.server.problems import Problem
from ambinav.server.served import MARK, ServedMap, ServedMaps
from ambinav.server.wire import read_map

STOP_SECONDS: Final = 10.0
"""In which a process leaves an edit that nobody waits for any more; else it is ended."""
SUPERSEDED: Final = "A later edit of this session has replaced this one."
STALE: Final = (
    "The session is at step {0} meanwhile, changed by somebody else; get its obstacles, and edit "
    "with after={0}."
)

MOVED: Final = "The session has moved to step {} meanwhile; get its steps, and ask again."

Obstacles = tuple[DrawnObstacle, ...]


class EditedMap(ServedMap):
    """A map with additional obstacles.

    Args:
        base: The original.
        obstacles: Obstacles added to its building.
        amap: The map of that.
        owner: The session that asked for it last.
    """

    def __init__(
        self, base: ServedMap, obstacles: Obstacles, amap: AmbiguityMap, owner: str | None
    ) -> None:
        super().__init__(name_of(base, obstacles), amap, f"{base.title}, edited")
        self.base = base
        self.obstacles = obstacles
        self.owner = owner
        self.bytes = int(amap.dataset.nbytes)


def name_of(base: ServedMap, obstacles: Obstacles) -> str:
    """Return the name of a map with these obstacles; without obstacles the original's name."""
    if not obstacles:
        return base.name
    digest = hashlib.sha256(to_json(collection(obstacles))).hexdigest()
    return f"{base.name}{MARK}{digest[:16]}"


class EditPool(PlanPool):
    """Processes that edit maps; a superseded edit is stopped and its process takes the next."""

    work = staticmethod(edits)
    what = "edit"
    remedy = "the map is too large to be edited on this server, or the machine too busy"

    async def _can_reuse(self, worker: Worker, answer: asyncio.Future[Any]) -> bool:
        try:
            worker.line.send(None)
            async with asyncio.timeout(STOP_SECONDS):
                await answer
        except (EOFError, OSError):  # TimeoutError is one
            return False
        return True


class Edits:
    """The edited maps of an application.

    Args:
        maps: The served maps.
        limits: Limits of number and time.
        file_of: Writes a map as a file for workers.
        folder: Gives that of the application.
        forget: Called with a map that is no longer served.
        state: Keeps obstacles and sessions.
    """

    def __init__(
        self,
        maps: ServedMaps,
        limits: Limits,
        file_of: Callable[[ServedMap], Awaitable[Path]],
        folder: Callable[[], Path],
        forget: Callable[[ServedMap], None],
        state: State,
    ) -> None:
        self._maps = maps
        self.state = state
        self._limits = limits
        self._file_of = file_of
        self._folder = folder
        self._forget = forget
        self.pool = EditPool(limits.edits, limits.waiting, limits.edit_seconds)
        self._latest: dict[tuple[str, str], asyncio.Task[ServedMap]] = {}
        self._numbers = itertools.count()

    async def find(
        self,
        base: ServedMap,
        obstacles: Obstacles,
        session: str | None,
        *,
        draft: bool = True,
        after: int | None = None,
        editor: str | None = None,
    ) -> tuple[ServedMap, int | None]:
        """Return the map with the obstacles (without any, the original), and the session's step.

        For the original, a process is prepared for later edits, unless it is a step of a session.

        Args:
            base: The original.
            obstacles: Obstacles to add to its building.
            session: Session; only its latest edit is computed. None: no session.
            draft: Whether the edit is no step of the session.
            after: Step that the session must be at, see `State.keep_edit`.
            editor: Who makes the edit.

        Raises:
            Problem: it cannot be had, another edit of the session was asked for meanwhile, or the
                session is at another step.
        """
        try:
            if session is not None:
                self.state.check_step(after, editor, session, base.name)
            task = asyncio.ensure_future(self._find(base, obstacles, session))
            if session is not None:
                key = session, base.name
                before = self._latest.get(key)
                if before is not None:
                    _cancel(before)
                self._latest[key] = task
                task.add_done_callback(partial(self._drop_finished, key))
            else:
                task.add_done_callback(_consume_error)
            edited = await asyncio.shield(task)
            text = to_json(collection(obstacles)).decode()
            step = self.state.keep_edit(
                edited.name, base.name, text, None if draft else session, after, editor
            )
            return edited, step
        except StaleStepError as stale:
            raise Problem(409, STALE.format(stale.position), field="after") from None
        except asyncio.CancelledError:
            asking = asyncio.current_task()
            if asking is not None and asking.cancelling():
                _cancel(task)
                raise
            raise Problem(409, SUPERSEDED) from None

    async def restored(self, name: str) -> ServedMap:
        """Compute an edited map again whose obstacles are known.

        Raises:
            Problem: they are not, or the map cannot be computed.
        """
        stored = self.state.obstacles_of(name)
        if stored is None:
            return self._maps.get(name)
        base = self._maps.get(stored[0])
        edited, _ = await self.find(base, obstacles_of(json.loads(stored[1]), "features"), None)
        return edited

    async def moved(self, base: ServedMap, session: str, by: int) -> tuple[ServedMap, int]:
        """Undo (-1) or redo (+1) a step of a session, and return its map and its number.

        Raises:
            Problem: there is no such step, its map cannot be computed, or the session moved on
                meanwhile.
        """
        position, steps = self.state.steps(session, base.name)
        names = {number: name for number, name, _, _ in steps} | {0: base.name}
        name = names.get(position + by)
        if name is None:
            action = "undo" if by < 0 else "redo"
            raise Problem(409, f"The session {session!r} has no step to {action}.", field="session")
        edited = base if name == base.name else await self.restored(name)
        try:
            self.state.move(session, base.name, position, position + by, name)
        except StaleStepError as stale:
            raise Problem(409, MOVED.format(stale.position), field="session") from None
        return edited, position + by

    def _drop_finished(self, key: tuple[str, str], task: asyncio.Task[ServedMap]) -> None:
        if self._latest.get(key) is task:
            del self._latest[key]
        _consume_error(task)

    def of(self, base: ServedMap) -> list[EditedMap]:
        """Return the edited maps of a map."""
        return [edited for edited in self._edited_maps() if edited.base is base]

    async def _find(self, base: ServedMap, obstacles: Obstacles, owner: str | None) -> ServedMap:
        name = name_of(base, obstacles)
        kept = next((edited for edited in self._edited_maps() if edited.name == name), None)
        if kept is not None:
            kept.owner = owner
            self._maps.get(name)  # it was used just now
            return kept
        if not obstacles and owner is not None:
            return base
        source = await self._file_of(base)
        place = self._folder() / f"edit-{next(self._numbers)}.npz"
        try:
            await self.pool.run(
                EditTask(
                    map_file=str(source),
                    map_name=base.name,
                    obstacles=tuple(drawn.obstacle for drawn in obstacles),
                    out=str(place),
                )
            )
            if not obstacles:
                return base
            amap = await asyncio.to_thread(read_map, place, base.name)
        finally:
            place.unlink(missing_ok=True)
        if not self._maps.holds(base):
            raise Problem(404, f"The map {base.name!r} is no longer served.", field="id")
        made = EditedMap(base, obstacles, amap, owner)
        self._maps.add_edited(made)
        self._make_room(made)
        return made

    def _edited_maps(self) -> list[EditedMap]:
        return [amap for amap in self._maps.edited if isinstance(amap, EditedMap)]

    def _make_room(self, last: EditedMap) -> None:
        """Delete edited maps beyond the limits.

        The owner of the most maps loses the one unused for longest.
        """
        while True:
            edited_maps = self._edited_maps()
            total = sum(edited.bytes for edited in edited_maps)
            if len(edited_maps) <= self._limits.kept_edits and total <= self._limits.edit_bytes:
                return
            others = [edited for edited in edited_maps if edited is not last]
            if not others:
                return
            ((most, _),) = Counter(edited.owner for edited in edited_maps).most_common(1)
            self._forget(next((edited for edited in others if edited.owner == most), others[0]))

    @property
    def running(self) -> int:
        """Number of edits that are computed."""
        return self.pool.running

    def close(self) -> None:
        """Stop all processes."""
        self.pool.close()


def _consume_error(task: asyncio.Task[ServedMap]) -> None:
    if not task.cancelled():
        task.exception()  # whoever has gone away does not ask for it


def _cancel(task: asyncio.Task[ServedMap]) -> None:
    """Cancel a task once: a second time would interrupt its clean-up."""
    if not task.cancelling():
        task.cancel()
