"""Queue of the tiles that are still to be made, and the work on one tile."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from ambinav.runtime.progress import Progress
from ambinav.tiles.job import Tile, TileInput, TileJob, tile_variables
from ambinav.tiles.plan import TilePlan
from ambinav.tiles.store import TileStore

MOST_DEATHS: Final = 5
"""Maximum number of processes that may be killed in a row before a tile is made."""


@dataclass(frozen=True)
class TileWork:
    """Makes and writes tiles, or checks them.

    Attributes:
        job: What all tiles have in common.
        store: Where they are written.
    """

    job: TileJob
    store: TileStore

    def __call__(self, task: TileTask) -> TileDone:
        """Make a tile and write it, or check one.

        Raises:
            InputError: it cannot be written.
        """
        start = time.perf_counter()
        if task.tile_input is None:
            free = self.store.holds(task.tile)
        else:
            free = self.store.write(task.tile, tile_variables(self.job, task.tile_input))
        return TileDone(task.tile, free, task.tile_input is not None, time.perf_counter() - start)


@dataclass(frozen=True, eq=False)
class TileTask:
    """Tile to make or to check.

    Attributes:
        tile: The tile.
        tile_input: What it is made of; None: it has a record, which is to be checked.
    """

    tile: Tile
    tile_input: TileInput | None


@dataclass(frozen=True)
class TileDone:
    """Result of a tile.

    Attributes:
        tile: The tile.
        free: Number of its free points; None: its record is not true.
        was_made: Whether it was made now.
        seconds: What it took.
    """

    tile: Tile
    free: int | None
    was_made: bool
    seconds: float


@dataclass(eq=False)
class TileQueue:
    """Queue of tiles to make; tiles that were lost are given out again.

    Attributes:
        plan: The map.
        report: Called with the share done.
        order: All tiles, with whether each has a record.
        total: Number of tiles.
        free: Number of free points so far.
        made: Number of tiles that were made.
        kept: Number of those that were there and sound.
        damaged: Number of those that were there and not as they were written.
        deaths: Number of workers that were killed since the last tile.
    """

    plan: TilePlan
    report: Progress
    order: Iterator[tuple[Tile, bool]]
    total: int
    free: int = 0
    made: int = 0
    kept: int = 0
    damaged: int = 0
    deaths: int = 0
    _lost: deque[Tile] = field(default_factory=deque)

    def take(self) -> TileTask | None:
        """Return the next tile; None: none is left now, but tiles in progress may come back."""
        if self._lost:
            tile = self._lost.popleft()
            return TileTask(tile, self.plan.input(tile))
        for tile, has_record in self.order:
            return TileTask(tile, None if has_record else self.plan.input(tile))
        return None

    def give(self, done: TileDone) -> None:
        """Record the result of a tile."""
        self.deaths = 0
        if done.free is None:
            self.damaged += 1
            self._lost.append(done.tile)
            return
        self.free += done.free
        if done.was_made:
            self.made += 1
        else:
            self.kept += 1
        self.report((self.made + self.kept) / self.total)

    def lost(self, task: TileTask, *, often: bool = False) -> None:
        """Queue a tile again, to be made in any case, as its worker was killed.

        Raises:
            RuntimeError: worker after worker was killed.
        """
        self.deaths += 1
        if often or self.deaths >= MOST_DEATHS:
            raise RuntimeError(
                "several worker processes in a row were killed, perhaps for lack of memory; fewer "
                "--workers or a smaller --tile need less"
            )
        self._lost.append(task.tile)
