"""Kill processes that build into one store of maps, and check for damage and deadlock.

Two processes take maps from one store, which has room for some of them only, so that they build,
keep, open and remove all the time. One of the two, at random, is killed (SIGKILL) at a random
moment, every second time at one while it writes, and another takes its place. Every map that any
of them got is compared, bit for bit, with the one that was built before without a store. In the end
two run without a kill, and the store is verified. Status 1: a map was another, an entry was
damaged, nothing came from a process for a minute, or something was left behind.

    python benchmarks/kill_store.py --out benchmarks/results/store.md
"""

from __future__ import annotations

import contextlib
import json
import math
import mmap
import os
import select
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely
from harness import arguments, option, report, table

import ambinav as an
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.content_digest import map_digest
from ambinav.runtime.files import replacing
from ambinav.store import map_store, upkeep
from ambinav.store.map_store import MapStore

WORKERS = 2
BUILT, MADE = 4, 3
"""Maps that are built, and large ones that are only copied, so that much is written."""
SPACING = 0.1
"""Spacing of the maps that are built, metres."""
CELLS = 1000
"""Along each side of the large ones: some 30 MB that no compression makes smaller."""
BETWEEN_KILLS = 4.0
"""By when the next kill comes at the latest: the time that a process takes for so many maps, as
the two come to `LAST` each before the first kill."""
STANDSTILL = 60.0
"""Seconds without a map after which a process counts as locked."""
LAST = 10
"""Maps that each process takes at the beginning and at the end, without a kill."""


LIMIT = 70_000_000
"""Bytes: two of the large maps have room, and all that are built."""
PHASES = ("between two maps", "opening, or waiting", "building", "packing", "writing")
BETWEEN, OPENING, BUILDING, PACKING, WRITING = range(len(PHASES))
AIMED = 2
"""One kill in so many waits until the process writes, which is a small part of its time, and then
for `WHILE_WRITING` seconds at the most."""
WHILE_WRITING = 0.01
PATIENCE = 5.0
"""Longest time until the process writes, seconds."""


@dataclass
class Outcome:
    """Results of the study.

    Attributes:
        kills: Processes that were killed.
        killed_while: At what, of `PHASES`.
        taken: Maps by whether they were opened or built.
        other: Those that were not what they should be.
        warned: Texts of the warnings.
        standstill: Whether a process made no progress.
        damaged: Entries that were, or were set aside.
        left_before: Locks and half-written files at the end.
        left: Those that the next clean-up left there.
        longest: Seconds between two kills at the most.
        seconds: All of it.
    """

    kills: int = 0
    killed_while: Counter[str] = field(default_factory=Counter)
    taken: Counter[str] = field(default_factory=Counter)
    other: list[str] = field(default_factory=list)
    warned: list[str] = field(default_factory=list)
    standstill: bool = False
    damaged: list[str] = field(default_factory=list)
    left_before: list[str] = field(default_factory=list)
    left: list[str] = field(default_factory=list)
    longest: float = 0.0
    seconds: float = 0.0

    @property
    def is_good(self) -> bool:
        """True if nothing went wrong."""
        return not (self.other or self.warned or self.standstill or self.damaged or self.left)


def scenes() -> list[an.Environment]:
    """Return rooms of different widths."""
    return [an.environment_from_shapes([shapely.box(0, 0, 4 + k, 3)]) for k in range(BUILT)]


def scanner() -> an.RangeScanner:
    """Return a laser that sees all around."""
    sensor = an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01)
    return an.RangeScanner.planar(sensor=sensor, beams=36, aperture=math.tau)


def large_maps(small: AmbiguityMap) -> list[AmbiguityMap]:
    """Return maps of random numbers."""
    made = []
    for k in range(MADE):
        rng = np.random.default_rng(k)
        values = rng.random((8, CELLS, CELLS), dtype=np.float32)
        big = small.dataset.isel(x=np.arange(CELLS) % 4, y=np.arange(CELLS) % 4)
        big = big.assign_coords(x=0.1 * np.arange(CELLS), y=0.1 * np.arange(CELLS))
        names = [
            name
            for name, variable in big.items()
            if variable.dims == ("y", "x") and variable.dtype == "f4"
        ]
        filled = {name: (("y", "x"), array) for name, array in zip(names, values, strict=False)}
        made.append(AmbiguityMap(big.assign(filled)))
    return made


class Worker:
    """A forked process that takes maps from the store and writes a line for each."""

    def __init__(self, work: Work, seed: int) -> None:
        read, write = os.pipe()
        self.phase = mmap.mmap(-1, 1)
        self.process = os.fork()
        if self.process == 0:
            os.close(read)
            status = 1
            try:
                work.run(seed, write, self.phase)
                status = 0
            finally:
                os._exit(status)
        os.close(write)
        self.lines = open(read, "rb", buffering=0)  # noqa: SIM115
        self.heard = time.monotonic()
        self.maps_taken = 0
        self.partial = b""

    def hear(self, outcome: Outcome) -> None:
        """Read its output so far."""
        while select.select([self.lines], [], [], 0)[0]:
            data = self.lines.read(65536)
            if not data:
                return
            self.heard = time.monotonic()
            *lines, self.partial = (self.partial + data).split(b"\n")
            for line in lines:
                kind, _, text = line.decode().partition(" ")
                if kind == "warned":
                    outcome.warned.append(text)
                elif kind == "other":
                    outcome.other.append(text)
                else:
                    outcome.taken[kind] += 1
                    self.maps_taken += 1

    def end(self, number: int, outcome: Outcome) -> None:
        """Send it a signal, and wait for its end."""
        os.kill(self.process, number)
        os.waitpid(self.process, 0)
        self.hear(outcome)
        self.lines.close()


class Work:
    """Task of the processes: take random maps, repeatedly."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.environments, self.scanner = scenes(), scanner()
        plain = [build_map(env, self.scanner, SPACING, store=False) for env in self.environments]
        self.large = large_maps(plain[0])
        self.digests = [map_digest(amap) for amap in (*plain, *self.large)]

    def run(self, seed: int, write: int, phase: mmap.mmap) -> None:
        """Take maps until killed; after SIGTERM finish the current map and return."""
        ended: list[int] = []
        signal.signal(signal.SIGTERM, lambda number, frame: ended.append(number))
        rng = np.random.default_rng(seed)
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            while not ended:
                k = int(rng.integers(len(self.digests)))
                opened, amap = self.take(k, phase)
                lines = ["opened" if opened else "built"]
                if map_digest(amap) != self.digests[k]:
                    lines.append(f"other {k}")
                lines += [f"warned {warning.message}" for warning in warned]
                warned.clear()
                os.write(write, ("\n".join(lines) + "\n").encode())

    def take(self, k: int, phase: mmap.mmap) -> tuple[bool, AmbiguityMap]:
        """Return a map by its number, and whether it was opened."""
        opened: list[str] = []

        def at(number: int) -> None:
            phase[0] = number

        def share_done(share: float) -> None:
            at(PACKING if share >= 1.0 else BUILDING)

        def copied(alive: object) -> AmbiguityMap:
            at(PACKING)
            return self.large[k - BUILT]

        @contextlib.contextmanager
        def writing(path: Path) -> Iterator[Path]:
            with replacing(path) as fresh:
                at(WRITING)
                yield fresh

        map_store.replacing = writing
        store = MapStore(self.folder, LIMIT, opened.append, lambda: at(BUILDING))
        at(OPENING)
        if k < BUILT:
            env = self.environments[k]
            amap = build_map(env, self.scanner, SPACING, progress=share_done, store=store)
        else:
            amap, _ = store.opened_or_built(f"{k:032x}", copied)
        at(BETWEEN)
        return any("is opened" in text for text in opened), amap


def study(folder: Path, kills: int, seed: int) -> Outcome:
    """Kill a number of processes.

    Args:
        folder: For the store.
        kills: Number of kills.
        seed: Seed of the times and processes of kills.
    """
    start = time.monotonic()
    outcome = Outcome()
    work = Work(folder)
    rng = np.random.default_rng(seed)
    begun = time.monotonic()
    workers = [Worker(work, k) for k in range(WORKERS)]
    try:
        _until_all_took(workers, outcome, LAST)
        outcome.longest = BETWEEN_KILLS * (time.monotonic() - begun) / LAST
        for k in range(kills):
            _listen(workers, outcome, rng.uniform(0.0, outcome.longest))
            which = int(rng.integers(WORKERS))
            if k % AIMED == 0:
                phase, until = workers[which].phase, time.monotonic() + PATIENCE
                while phase[0] != WRITING and time.monotonic() < until:
                    _listen(workers, outcome, 0.0005)
                time.sleep(rng.uniform(0.0, WHILE_WRITING))
            workers[which].end(signal.SIGKILL, outcome)
            outcome.kills += 1
            outcome.killed_while[PHASES[workers[which].phase[0]]] += 1
            workers[which] = Worker(work, WORKERS + k)
        _until_all_took(workers, outcome, LAST)
    except TimeoutError:
        outcome.standstill = True
    finally:
        for worker in workers:
            worker.end(signal.SIGKILL if outcome.standstill else signal.SIGTERM, outcome)
    store = MapStore(folder, LIMIT)
    outcome.damaged += [f"{entry.key}: {why}" for entry, why in upkeep.verify(store) if why]
    outcome.damaged += [path.name for path in folder.glob("*.damaged")]
    outcome.left_before = _leftovers(folder)
    store.make_room(LIMIT)
    outcome.left = _leftovers(folder)
    outcome.seconds = time.monotonic() - start
    return outcome


def _until_all_took(workers: Sequence[Worker], outcome: Outcome, count: int) -> None:
    """Wait until each process has taken a number of further maps; raise as `_listen` does."""
    goal = [worker.maps_taken + count for worker in workers]
    while any(worker.maps_taken < maps for worker, maps in zip(workers, goal, strict=True)):
        _listen(workers, outcome, 0.01)


def _listen(workers: Sequence[Worker], outcome: Outcome, seconds: float) -> None:
    """Read the output of processes for some time.

    Raises:
        TimeoutError: one has written nothing for `STANDSTILL`.
    """
    until = time.monotonic() + seconds
    while (remaining := until - time.monotonic()) > 0.0:
        select.select([worker.lines for worker in workers], [], [], remaining)
        for worker in workers:
            worker.hear(outcome)
            if time.monotonic() - worker.heard > STANDSTILL:
                raise TimeoutError


KEPT = (".map", ".TAG")


def _leftovers(folder: Path) -> list[str]:
    """Return locks and half-written files."""
    return sorted(path.name for path in folder.glob("*") if path.suffix not in KEPT)


def text(outcome: Outcome, seed: int) -> str:
    """Return the report."""
    counts = outcome.taken
    rows = [
        ("processes killed", outcome.kills),
        *((f"- while {phase}", outcome.killed_while[phase]) for phase in PHASES),
        ("maps taken", sum(counts.values())),
        *((f"- {kind}", counts[kind]) for kind in ("opened", "built")),
        ("maps that were not bit for bit what they should be", len(outcome.other)),
        ("entries damaged, or set aside", len(outcome.damaged)),
        ("warnings", len(outcome.warned)),
        (f"processes without a map for {STANDSTILL:.0f} s", int(outcome.standstill)),
        ("locks and half-written files at the end", len(outcome.left_before)),
        ("and after the next clean-up", len(outcome.left)),
        ("seconds", f"{outcome.seconds:.0f}"),
    ]
    return (
        f"{WORKERS} processes, {BUILT} maps that are built and {MADE} of 30 MB that are copied, "
        f"room for {LIMIT / 1e6:.0f} MB; a kill 0 to {outcome.longest:.2f} s after the one "
        f"before, every second one while an entry is written, seed {seed}.\n\n"
        f"{table(('', 'count'), rows)}\n\n"
        f"**{'Passed' if outcome.is_good else 'FAILED'}.**"
    )


def main() -> int:
    """Run the study; return the exit status."""
    args = arguments(
        __doc__,
        kills=200,
        seed=22,
        folder=option(None, "for the store (default: a temporary one)", type=Path),
        json=option(False, "print the outcome as JSON"),
    )
    folder = args.folder or Path(tempfile.mkdtemp(prefix="kill-store-"))
    try:
        outcome = study(folder, args.kills, args.seed)
    finally:
        if args.folder is None:
            shutil.rmtree(folder)
    if args.json:
        print(json.dumps(vars(outcome) | {"good": outcome.is_good}))
    else:
        report("Kills while two processes build into one store", ("ambinav", "numba", "numpy"),
               text(outcome, args.seed), args.out)  # fmt: skip
    return 0 if outcome.is_good else 1


if __name__ == "__main__":
    sys.exit(main())
