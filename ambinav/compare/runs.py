"""Driving all routes of a scenario in parallel processes; what is done is not done again."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from ambinav.compare.code import code_checksum
from ambinav.compare.controllers import Driver
from ambinav.compare.plans import Plan
from ambinav.compare.results import Results, joined, load_results, results_of, save_results
from ambinav.compare.workers import Item, Setup, drive_item, in_workers

BLOCK = 10
"""Runs in one piece of work."""

CODE = (
    *("compare/controllers.py", "compare/guides.py", "compare/results.py", "compare/workers.py"),
    "drive/*.py",
    *("geometry/*.py", "localization/*.py", "maps/*.py", "sensing/*.py", "service/*.py"),
)
"""Files of ambinav that the outcome of a drive depends on."""


def drive_all(
    setup: Setup,
    plans: tuple[Plan, ...],
    folder: Path,
    *,
    jobs: int = 1,
    progress: Callable[[float], None] | None = None,
) -> tuple[Results, ...]:
    """Drive each route as often as the scenario says.

    Args:
        setup: The scenario with its worlds; its map tells exposure and weak direction.
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
    items = [item for plan in plans for item in items_of(setup, plan)]
    paths = {item.key: folder / f"{item.key}.npz" for item in items}
    todo = {item.key: item for item in items if load_results(paths[item.key]) is None}
    report = progress or (lambda share: None)
    done = len(paths) - len(todo)
    report(done / len(paths))
    for item, results in in_workers(setup, _drive, list(todo.values()), jobs):
        save_results(results, paths[item.key])
        done += 1
        report(done / len(paths))
    found = {key: load_results(path) for key, path in paths.items()}
    return tuple(
        joined([_there(found[item.key]) for item in items if item.plan is plan]) for plan in plans
    )


def _there(results: Results | None) -> Results:
    if results is None:
        raise RuntimeError("results that were just written cannot be read")
    return results


def _drive(setup: Setup, item: Item) -> Results:
    from ambinav.drive.metrics import metrics

    drives = drive_item(setup, item)
    measured = metrics(drives, setup.amap, setup.scenario.map.layer)
    return results_of(drives, measured, item.plan.route.length)


def items_of(setup: Setup, plan: Plan) -> list[Item]:
    """The pieces of work of a route."""
    runs = setup.scenario.drive.runs
    common = _common(setup)
    world = setup.worlds[plan.pair].segments.xy.tobytes()
    items = []
    for block, first in enumerate(range(0, runs, BLOCK)):
        size = min(BLOCK, runs - first)
        digest = hashlib.sha256(common)
        steering = plan.route.steering
        told = (plan.pair, block, size, steering.space, steering.radius, plan.route.turn)
        digest.update(json.dumps(told).encode())
        digest.update(plan.route.poses.tobytes())
        digest.update(world)
        if plan.driver is not None:
            digest.update(_told_of(plan.driver))
        items.append(Item(plan, block, size, digest.hexdigest()[:32]))
    return items


def _told_of(driver: Driver) -> bytes:
    """What the drives of a policy depend on besides."""
    from ambinav.compare.leaderboard.store import code_checksum as code_with_environments

    told = [driver.told, driver.checksum, driver.start, driver.goal, code_with_environments()]
    return json.dumps(told).encode()


PARTS = ("robot", "follower", "odometry", "people")


def _common(setup: Setup) -> bytes:
    """What the outcome of every piece depends on."""
    scenario = setup.scenario
    guide = scenario.guide
    how = scenario.drive.model_dump(exclude={"runs"})
    told = {
        "code": code_checksum(CODE),
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
