"""State of a server that outlives it: edits, sessions, plans and audits, in SQLite.

Each change is one transaction, made before the answer that confirms it: what was confirmed is there
after the process is killed. (A power cut may take the last changes.)
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import sqlite3
import threading
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import disk_is_full
from ambinav.store.build_lock import try_lock

FILE: Final = "state.sqlite"
FORMAT: Final = 2
"""Format of the file; another one is refused."""
MOST_EDITS: Final = 10_000
"""Edited maps that are known by their obstacles, and steps of all sessions together."""
MOST_PLANS: Final = 1000
MOST_STARTS: Final = 5
"""Starts of a job: perhaps it is the job that ends the server."""
CUT_OFF: Final = f"The server ended {MOST_STARTS} times during this job; start it again."
DISK_RETRY_SECONDS: Final = 2.0
"""Seconds after which a full disk is tried again."""

_TABLES: Final = """
CREATE TABLE IF NOT EXISTS edited (
    name TEXT PRIMARY KEY, map TEXT NOT NULL, obstacles TEXT NOT NULL, changed REAL NOT NULL);
CREATE TABLE IF NOT EXISTS sessions (
    session TEXT, map TEXT, position INTEGER NOT NULL, PRIMARY KEY (session, map));
CREATE TABLE IF NOT EXISTS steps (
    session TEXT, map TEXT, number INTEGER, name TEXT NOT NULL, created REAL NOT NULL, editor TEXT,
    PRIMARY KEY (session, map, number));
CREATE TABLE IF NOT EXISTS jobs (
    id TEXT PRIMARY KEY, kind TEXT NOT NULL, task TEXT NOT NULL, state TEXT NOT NULL, result TEXT,
    created REAL NOT NULL, starts INTEGER NOT NULL);
"""


class StaleStepError(Exception):
    """An edit or an undo goes on from a step that is no longer the current one of its session."""

    def __init__(self, position: int) -> None:
        super().__init__(position)
        self.position = position


class State:
    """Edits and jobs of a server.

    Args:
        folder: Folder in which they are kept; None: in memory, until the server ends.

    Raises:
        InputError: the folder cannot be written to, another server uses it, or its file is none of
            ours.
    """

    def __init__(self, folder: Path | None) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._locks = contextlib.ExitStack()
        try:
            if folder is not None:
                folder.mkdir(mode=0o700, parents=True, exist_ok=True)
                lock = try_lock(folder / "lock")
                if lock is None:
                    raise InputError(
                        f"--state: {folder} is in use by another server; give another folder."
                    )
                self._locks.enter_context(lock)
            self._data = sqlite3.connect(
                ":memory:" if folder is None else folder / FILE,
                check_same_thread=False,
                isolation_level=None,
            )
            weakref.finalize(self, self._data.close)
            self._open()
        except (OSError, sqlite3.Error) as error:
            self._locks.close()
            raise InputError(
                f"--state: {folder} cannot be used ({error}); give a folder that can be written "
                "to, new or from another start of the server."
            ) from error

    def _open(self) -> None:
        (version,) = self._data.execute("PRAGMA user_version").fetchone()
        if version not in (0, FORMAT):
            raise InputError(
                f"--state: {self.folder} has format {version}, and this version of ambinav writes "
                f"{FORMAT}; give another folder."
            )
        self._data.execute("PRAGMA journal_mode = WAL")
        self._data.execute("PRAGMA synchronous = NORMAL")
        self._data.executescript(_TABLES)
        self._data.execute(f"PRAGMA user_version = {FORMAT}")

    @contextlib.contextmanager
    def _change(self) -> Iterator[sqlite3.Connection]:
        """Make all changes or none."""
        with self._lock:
            self._data.execute("BEGIN IMMEDIATE")
            try:
                yield self._data
            except BaseException:
                if self._data.in_transaction:  # SQLite itself ends it when the disk is full
                    self._data.execute("ROLLBACK")
                raise
            self._data.execute("COMMIT")

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        with self._lock:
            return self._data.execute(query, values).fetchall()

    def keep_edit(
        self,
        name: str,
        map: str,
        obstacles: str,
        session: str | None,
        after: int | None = None,
        editor: str | None = None,
    ) -> int | None:
        """Keep the obstacles of an edited map, and make it the last step of a session.

        Steps that were undone are dropped. Returns the session's position then.

        Args:
            name: Id of the edited map, or of the original.
            map: Id of the original.
            obstacles: Obstacles as GeoJSON.
            session: Name of the session; None: none.
            after: Position that the session must be at, or a later step of the same editor; None:
                any.
            editor: Who makes the edit, any name.

        Raises:
            StaleStepError: it is at a step of somebody else; the edit is no step of it.
        """
        now = time.time()
        with self._change() as data:
            data.execute("REPLACE INTO edited VALUES (?, ?, ?, ?)", (name, map, obstacles, now))
            _trim(data)
            if session is None:
                return None
            key = session, map
            position = self._position(*key)
            self._check_step(after, editor, *key)
            last = self._step(position, *key)
            if (last is None and name == map) or (last is not None and last[0] == name):
                return position
            data.execute(
                "DELETE FROM steps WHERE session = ? AND map = ? AND number > ?", (*key, position)
            )
            data.execute(
                "INSERT INTO steps VALUES (?, ?, ?, ?, ?, ?)",
                (*key, position + 1, name, now, editor),
            )
            data.execute("REPLACE INTO sessions VALUES (?, ?, ?)", (*key, position + 1))
            return position + 1

    def obstacles_of(self, name: str) -> tuple[str, str] | None:
        """Return the original's id and the obstacles of an edited map, as GeoJSON."""
        rows = self._rows("SELECT map, obstacles FROM edited WHERE name = ?", name)
        return rows[0] if rows else None

    def _position(self, session: str, map: str) -> int:
        row = self._data.execute(
            "SELECT position FROM sessions WHERE session = ? AND map = ?", (session, map)
        ).fetchone()
        return 0 if row is None else int(row[0])

    def _step(self, number: int, session: str, map: str) -> tuple[str, str | None] | None:
        """Return the map and the editor of a step."""
        query = "SELECT name, editor FROM steps WHERE session = ? AND map = ? AND number = ?"
        row: tuple[str, str | None] | None = self._data.execute(
            query, (session, map, number)
        ).fetchone()
        return row

    def _check_step(self, after: int | None, editor: str | None, session: str, map: str) -> None:
        position = self._position(session, map)
        if after in (None, position):
            return
        last = self._step(position, session, map)
        # A step back was an undo, of which the editor of the step may not have heard.
        if last is None or editor is None or last[1] != editor or position < after:
            raise StaleStepError(position)

    def check_step(self, after: int | None, editor: str | None, session: str, map: str) -> None:
        """Check that an edit goes on from the current step of a session, as `keep_edit` does.

        Raises:
            StaleStepError: it does not.
        """
        with self._lock:
            self._check_step(after, editor, session, map)

    def steps(self, session: str, map: str) -> tuple[int, list[tuple[int, str, float, str | None]]]:
        """Return the position of a session, 0 for the original, and its steps.

        Each step is its number, from 1 on, the id of its map, its time, seconds since 1970, and its
        editor. The first ones of a long session may have been dropped.
        """
        rows = self._rows(
            "SELECT number, name, created, editor FROM steps WHERE session = ? AND map = ? ORDER "
            "BY number",
            session,
            map,
        )
        with self._lock:
            return self._position(session, map), rows

    def move(self, session: str, map: str, before: int, position: int, name: str) -> None:
        """Set the position of a session, after its map was found.

        Args:
            session: Name of the session.
            map: Id of the original.
            before: Its position so far.
            position: The new one.
            name: Id of the map at that step.

        Raises:
            StaleStepError: it is at another one meanwhile, or the step is another one.
        """
        with self._change() as data:
            step = self._step(position, session, map)
            there = map if position == 0 else None if step is None else step[0]
            now = self._position(session, map)
            if now != before or there != name:
                raise StaleStepError(now)
            data.execute("REPLACE INTO sessions VALUES (?, ?, ?)", (session, map, position))

    def delete_session(self, session: str, map: str) -> None:
        """Delete a session and its steps."""
        with self._change() as data:
            for kind in ("sessions", "steps"):
                data.execute(f"DELETE FROM {kind} WHERE session = ? AND map = ?", (session, map))

    def keep_job(self, id: str, kind: str, task: dict[str, Any]) -> None:
        """Keep a job that waits."""
        with self._change() as data:
            data.execute(
                "INSERT INTO jobs VALUES (?, ?, ?, 'waiting', NULL, ?, 0)",
                (id, kind, json.dumps(task), time.time()),
            )
            data.execute(
                "DELETE FROM jobs WHERE kind = 'plan' AND state != 'waiting' AND id IN (SELECT id "
                "FROM jobs WHERE kind = 'plan' ORDER BY created DESC LIMIT -1 OFFSET ?)",
                (MOST_PLANS,),
            )

    def count_start(self, id: str) -> None:
        """Count a start of a job, before its work."""
        with self._change() as data:
            data.execute("UPDATE jobs SET starts = starts + 1 WHERE id = ?", (id,))

    def may_start(self, id: str) -> bool:
        """Return whether a job that was cut off had less than `MOST_STARTS`."""
        return bool(self._rows("SELECT 1 FROM jobs WHERE id = ? AND starts < ?", id, MOST_STARTS))

    def end_job(self, id: str, state: str, result: str | None) -> None:
        """Keep the end of a job: "done" or "failed", and its result or the reason."""
        with self._change() as data:
            data.execute("UPDATE jobs SET state = ?, result = ? WHERE id = ?", (state, result, id))

    async def job_ended(self, id: str, state: str, result: str | None) -> None:
        """Keep the end of a job as `end_job` does; while the disk is full, wait for room."""
        while True:
            try:
                return self.end_job(id, state, result)
            except sqlite3.OperationalError as error:
                if not disk_is_full(error):
                    raise
            await asyncio.sleep(DISK_RETRY_SECONDS)

    def drop_job(self, id: str) -> None:
        """Delete a job."""
        with self._change() as data:
            data.execute("DELETE FROM jobs WHERE id = ?", (id,))

    def jobs(self, kind: str) -> list[tuple[str, dict[str, Any], str, str | None]]:
        """Return id, task, state and result of all jobs of a kind, the oldest first."""
        rows = self._rows(
            "SELECT id, task, state, result FROM jobs WHERE kind = ? ORDER BY created, rowid", kind
        )
        return [(id, json.loads(task), state, result) for id, task, state, result in rows]

    def job(self, id: str, kind: str) -> tuple[dict[str, Any], str, str | None] | None:
        """Return task, state and result of a job of a kind."""
        query = "SELECT task, state, result FROM jobs WHERE id = ? AND kind = ?"
        rows = self._rows(query, id, kind)
        return (json.loads(rows[0][0]), *rows[0][1:]) if rows else None

    def close(self) -> None:
        """Close the file."""
        with self._lock:
            self._data.close()
        self._locks.close()


def _trim(data: sqlite3.Connection) -> None:
    """Drop the oldest steps, and the oldest edits that are in none, once there are far too many."""
    for table, condition, order, most in (
        ("steps", "TRUE", "created", 1.1 * MOST_EDITS),
        ("edited", "name NOT IN (SELECT name FROM steps)", "changed", 2.2 * MOST_EDITS),
    ):
        (count,) = data.execute(f"SELECT count(*) FROM {table}").fetchone()
        if count > most:
            data.execute(
                f"DELETE FROM {table} WHERE rowid IN (SELECT rowid FROM {table} WHERE {condition} "
                f"ORDER BY {order} DESC LIMIT -1 OFFSET {MOST_EDITS})"
            )
