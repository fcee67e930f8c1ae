"""Drives along all routes of a scenario in parallel processes; finished work is reused."""

from __future__ import annotations

from pathlib import Path

from ambinav.maps.content_digest import environment_digest, map_digest
from ambinav.runtime.progress import Progress, silent
from ambinav.runtime.provenance import POLICIES, Provenance, digest_of
from ambinav.studies.compare.controllers import Driver
from ambinav.studies.compare.plans import Plan
from ambinav.studies.compare.results import Results, joined, load_results, results_of, save_results
from ambinav.studies.compare.workers import Item, Setup, drive_item, in_workers

BLOCK = 10
"""Runs in one piece of work."""


def drive_all(
    setup: Setup,
    plans: tuple[Plan, ...],
    folder: Path,
    *,
    jobs: int = 1,
    progress: Progress = silent,
) -> tuple[Results, ...]:
    """Drive each route as many times as the scenario says.

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
        InputError: what `ambinav.drive.drive.drive_route` refuses.
    """
    items = [item for plan in plans for item in items_of(setup, plan)]
    paths = {item.key: folder / f"{item.key}.npz" for item in items}
    todo = {item.key: item for item in items if load_results(paths[item.key]) is None}
    done = len(paths) - len(todo)
    progress(done / len(paths))
    for item, results in in_workers(setup, _drive, list(todo.values()), jobs):
        save_results(results, paths[item.key])
        done += 1
        progress(done / len(paths))
    stored = {key: load_results(path) for key, path in paths.items()}
    return tuple(
        joined([_required(stored[item.key]) for item in items if item.plan is plan])
        for plan in plans
    )


def _required(results: Results | None) -> Results:
    if results is None:
        raise RuntimeError("results that were just written cannot be read")
    return results


def _drive(setup: Setup, item: Item) -> Results:
    from ambinav.drive.metrics import metrics

    drives = drive_item(setup, item)
    measured = metrics(drives, setup.amap, setup.scenario.map.layer)
    return results_of(drives, measured, item.plan.route.length)


def items_of(setup: Setup, plan: Plan) -> list[Item]:
    """Return the work items of a route."""
    runs = setup.scenario.drive.runs
    route, steering = plan.route, plan.route.steering
    common = (
        _common(setup),
        plan.pair,
        (steering.space, steering.radius, route.turn, route.poses),
        environment_digest(setup.worlds[plan.pair]),
        None if plan.driver is None else _driver_digest(plan.driver),
    )
    items = []
    for block, first in enumerate(range(0, runs, BLOCK)):
        size = min(BLOCK, runs - first)
        items.append(Item(plan, block, size, digest_of(common, block, size)[:32]))
    return items


def _driver_digest(driver: Driver) -> str:
    """Compute a digest of what the drives of a policy depend on in addition."""
    here = Provenance.here(*POLICIES).digest
    return digest_of(driver.source, driver.checksum, driver.start, driver.goal, here)


PARTS = ("robot", "follower", "odometry", "people")


def _common(setup: Setup) -> str:
    """Compute a digest of the inputs shared by all work items."""
    scenario = setup.scenario
    return digest_of(
        Provenance.here().digest,
        setup.scanner.to_yaml(),
        map_digest(setup.amap),
        environment_digest(setup.environment),
        scenario.map.layer,
        scenario.chosen_localizer.identity,
        scenario.drive.model_dump(exclude={"runs"}),
        [getattr(scenario, name) for name in PARTS],
    )
