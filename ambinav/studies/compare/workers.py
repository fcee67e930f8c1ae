"""Worker processes that drive: their setup and their work items."""

from __future__ import annotations

import multiprocessing
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ambinav.drive.drives import Drives
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.processes import begin_worker, putting_signals_off
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.compare.controllers import controller_of
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.scenario import Scenario

Piece = TypeVar("Piece")
Made = TypeVar("Made")


@dataclass(frozen=True, eq=False)
class Setup:
    """Data shared by all work items; each process receives it once.

    Attributes:
        scenario: The scenario.
        environment: The building as in the localizer's map.
        scanner: The scanner.
        amap: The ambiguity map.
        worlds: The true buildings, by pair.
    """

    scenario: Scenario
    environment: Environment
    scanner: RangeScanner
    amap: AmbiguityMap
    worlds: dict[str, Environment]


@dataclass(frozen=True, eq=False)
class Item:
    """A work item: `runs` drives along a route, with the seeds of a block.

    Attributes:
        plan: The route.
        block: Number of the block; the same block of two routes of a pair has the same seeds.
        runs: How many.
        key: Checksum of everything that the outcome depends on.
    """

    plan: Plan
    block: int
    runs: int
    key: str


def drive_item(setup: Setup, item: Item, *, keep_ranges: bool = False) -> Drives:
    """Drive a work item; the result is reproducible.

    Args:
        setup: Data shared by all work items.
        item: The piece.
        keep_ranges: Keep all readings.

    Raises:
        InputError: what `ambinav.drive.drive.drive_route` refuses.
    """
    from ambinav.drive.drive import drive_route

    scenario, how = setup.scenario, setup.scenario.drive
    controller = None
    if item.plan.driver is not None:
        controller = controller_of(
            item.plan.driver, setup.environment, setup.scanner, scenario.robot, how.rate, item.runs
        )
    return drive_route(
        setup.environment,
        setup.scanner,
        scenario.robot,
        item.plan.route,
        scenario.chosen_localizer,
        np.random.default_rng([how.seed, zlib.crc32(item.plan.pair.encode()), item.block]),
        item.runs,
        world=setup.worlds[item.plan.pair],
        follower=scenario.follower,
        noise=scenario.odometry,
        people=scenario.people,
        open_loop=how.open_loop,
        rate=how.rate,
        start_std=how.start_deviations,
        max_time=how.max_time,
        keep_ranges=keep_ranges,
        controller=controller,
    )


def in_workers(
    setup: Setup, function: Callable[[Setup, Piece], Made], pieces: Sequence[Piece], jobs: int
) -> Iterator[tuple[Piece, Made]]:
    """Process work items in worker processes.

    Args:
        setup: Data shared by all work items.
        function: Does a piece; a function of a module, so that it can be found there.
        pieces: The pieces.
        jobs: How many processes, at most.

    Yields:
        Each piece with its outcome, as they are done.

    Raises:
        RuntimeError: a process was killed.
        Exception: what `function` raises.
    """
    if not pieces:
        return
    # Fresh processes, not forks: numba's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(jobs, len(pieces)), context, _initialize, (setup,)) as pool:
        try:
            # The first piece goes alone: after an installation it compiles the kernels, which
            # the other processes then only have to load.
            with putting_signals_off():
                first = pool.submit(_call, function, pieces[0])
            yield pieces[0], first.result()
            with putting_signals_off():
                pending = {pool.submit(_call, function, piece): piece for piece in pieces[1:]}
            for future in as_completed(pending):
                yield pending[future], future.result()
        except BrokenProcessPool as error:
            raise RuntimeError(
                "a worker process was killed, perhaps for lack of memory; fewer --jobs need less"
            ) from error
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


@dataclass
class _Worker:
    setup: Setup | None = None


_worker = _Worker()


def _initialize(setup: Setup) -> None:
    """Initialize a worker process."""
    begin_worker()
    _worker.setup = setup


def _call(function: Callable[[Setup, Any], Made], piece: Any) -> Made:
    if _worker.setup is None:
        raise RuntimeError("this process was not made ready")
    return function(_worker.setup, piece)
