"""Driving all routes of a scenario in parallel processes; what is done is not done again."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import signal
import zlib
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from ambinav.compare.plans import Plan
from ambinav.compare.results import Results, joined, load_results, results_of, save_results
from ambinav.compare.scenario import Scenario
from ambinav.compare.scenario_file import Loaded
from ambinav.geometry.environment import Environment
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing.scanner import RangeScanner

BLOCK = 10
"""Runs in one piece of work."""

FORMAT = 1
"""Goes up whenever the same inputs may give other drives, so that old ones are not taken."""


@dataclass(frozen=True, eq=False)
class Setup:
    """What all pieces of work have in common; each worker process gets it once."""

    scenario: Scenario
    environment: Environment
    scanner: RangeScanner
    amap: AmbiguityMap


@dataclass(frozen=True, eq=False)
class Item:
    """A piece of work: `runs` drives along a route, with the seeds of a block.

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


def drive_all(
    loaded: Loaded,
    amap: AmbiguityMap,
    plans: tuple[Plan, ...],
    folder: Path,
    *,
    jobs: int = 1,
    progress: Callable[[float], None] | None = None,
) -> tuple[Results, ...]:
    """Drive each route as often as the scenario says.

    Args:
        loaded: The scenario.
        amap: Its map, for exposure and weak direction.
        plans: The routes.
        folder: Keeps a file for each piece of work. Pieces whose inputs are unchanged are read
            from there.
        jobs: How many processes; the outcome does not depend on it.
        progress: Called with the share done.

    Returns:
        One for each route, in the order of `plans`.

    Raises:
        InputError: what `ambinav.drive.drive` refuses.
    """
    setup = Setup(loaded.scenario, loaded.environment, loaded.scanner, amap)
    items = [item for plan in plans for item in _items(setup, plan)]
    paths = {item.key: folder / f"{item.key}.npz" for item in items}
    todo = {item.key: item for item in items if load_results(paths[item.key]) is None}
    report = progress or (lambda share: None)
    count = len(paths)
    report(1.0 - len(todo) / count)
    if todo:
        _work(setup, list(todo.values()), paths, min(jobs, len(todo)), count, report)
    found = {key: load_results(path) for key, path in paths.items()}
    return tuple(
        joined([_there(found[item.key]) for item in items if item.plan is plan]) for plan in plans
    )


def _there(results: Results | None) -> Results:
    if results is None:
        raise RuntimeError("results that were just written cannot be read")
    return results


def _work(
    setup: Setup,
    items: list[Item],
    paths: dict[str, Path],
    jobs: int,
    count: int,
    report: Callable[[float], None],
) -> None:
    """Do the pieces in processes of their own, and write each when it is done."""
    # Fresh processes, not forks: numba's threads do not survive a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, _begin, (setup,)) as pool:
        try:
            pending = {pool.submit(_drive, item): item for item in items}
            for done, future in enumerate(as_completed(pending)):
                save_results(future.result(), paths[pending[future].key])
                report(1.0 - (len(items) - done - 1) / count)
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


def _begin(setup: Setup) -> None:
    """Make a process ready; Ctrl-C is for the one that gives out the work."""
    import numba

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    numba.set_num_threads(1)
    _worker.setup = setup


def _drive(item: Item) -> Results:
    from ambinav.drive.drive import drive
    from ambinav.drive.metrics import metrics

    setup = _worker.setup
    if setup is None:
        raise RuntimeError("this process was not made ready")
    scenario, how = setup.scenario, setup.scenario.drive
    drives = drive(
        setup.environment,
        setup.scanner,
        scenario.robot,
        item.plan.route,
        scenario.guide,
        np.random.default_rng([how.seed, zlib.crc32(item.plan.pair.encode()), item.block]),
        item.runs,
        follower=scenario.follower,
        noise=scenario.odometry,
        people=scenario.people,
        open_loop=how.open_loop,
        rate=how.rate,
        start_std=how.start_std,
        max_time=how.max_time,
    )
    measured = metrics(drives, setup.amap, scenario.map.layer)
    return results_of(drives, measured, item.plan.route.length)


def _items(setup: Setup, plan: Plan) -> list[Item]:
    """The pieces of work of a route."""
    runs = setup.scenario.drive.runs
    common = _common(setup)
    items = []
    for block, first in enumerate(range(0, runs, BLOCK)):
        size = min(BLOCK, runs - first)
        digest = hashlib.sha256(common)
        steering = plan.route.steering
        told = (plan.pair, block, size, steering.space, steering.radius, plan.route.turn)
        digest.update(json.dumps(told).encode())
        digest.update(plan.route.poses.tobytes())
        items.append(Item(plan, block, size, digest.hexdigest()[:32]))
    return items


def _common(setup: Setup) -> bytes:
    """What the outcome of every piece depends on."""
    from ambinav import __version__

    scenario = setup.scenario
    guide = scenario.guide
    how = scenario.drive.model_dump(exclude={"runs"})
    told = {
        "format": FORMAT,
        "version": __version__,
        "scanner": setup.scanner.to_yaml(),
        "map": setup.amap.dataset.attrs.get("parameters"),
        "layer": scenario.map.layer,
        "localizer": guide if isinstance(guide, str) else asdict(guide),
        "drive": how,
        **{name: asdict(getattr(scenario, name)) for name in PARTS},
    }
    digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode())
    segments = setup.environment.segments
    digest.update(segments.xy.tobytes())
    digest.update(segments.kind.tobytes())
    return digest.digest()


PARTS = ("robot", "follower", "odometry", "people")
