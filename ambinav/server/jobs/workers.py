"""Tasks of worker processes: plans, audits of uploaded maps, and edits of maps."""

from __future__ import annotations

import contextlib
import errno
import math
import os
import re
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import xarray as xr

from ambinav.geometry.obstacle import Obstacle
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE
from ambinav.plugins import load_module
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import disk_is_full
from ambinav.runtime.processes import ChildProcess, begin_worker
from ambinav.runtime.progress import Progress
from ambinav.sensing.scanner import RangeScanner
from ambinav.server.jobs.route_forecasts import route_forecasts
from ambinav.server.wire import read_map, write_dataset
from ambinav.service.service import AmbiguityService

PLANNERS: Final = "ambinav_planners"
"""The package that plans, loaded by its name: it stands on a higher floor."""
NICE: Final = 10
"""By so much a job yields to the server, which answers short questions meanwhile."""
REPORT_EVERY: Final = 0.2
"""Seconds between two reports of progress."""

FIGURES: Final = (
    "length", "cost", "exposure", "weight", "layer", "planner", "seed", "zone_metres",
    "unexplored_metres", "longest_bad", "turn", "seconds",
)  # fmt: skip
"""Figures of a route in the answer, named as its attributes."""
SAME: Final = 1e-6
"""Metres between points of two lattices that are one."""
WARMING: Final = 0.02
"""Radius of the post, metres, that is put in and thrown away before the first edit of a map."""


@dataclass(frozen=True)
class PlanTask:
    """A task to plan one route, or one for each of several weights.

    Attributes:
        map_file: A map as `wire.write_dataset` writes it.
        map_name: Name in messages.
        layer: Layer of the costs.
        weight: Weight of the cost.
        weights: One route for each of them; None: one route at `weight`.
        start: x, y and perhaps theta, metres and radians.
        goal: The same.
        planner: Its name; None: the one that suits.
        seconds: Time for planning.
        seed: Seed of the planner.
        radius: Radius of the robot, metres; None: the default of `RoutePlanner`.
        odometry: Name of the odometry that routes are forecast for.
        localizer: Name of the localizer's class.
    """

    map_file: str
    map_name: str
    layer: str
    weight: float
    weights: tuple[float, ...] | None
    start: tuple[float, ...]
    goal: tuple[float, ...]
    planner: str | None
    seconds: float
    seed: int | None
    radius: float | None
    odometry: str
    localizer: str


@dataclass(frozen=True)
class AuditTask:
    """A task to audit an uploaded map.

    Attributes:
        scanner: YAML text of a scanner.
        spacing: Spacing of the ambiguity map, metres.
        radius: Radius of its neighbourhoods, metres.
        headings: How many; None: the scanner decides.
        level: Floor of a plan that holds several, by name or position; None: there is one.
        unit: Unit of a plan's coordinates; None: metres.
        folder: Holds the map under `map_name`; report and ambiguity map are written there.
        map_name: File in the folder.
        title: Name of the building.
        cells: Maximum number of cells, over all headings.
    """

    scanner: str
    spacing: float
    radius: float
    headings: int | None = None
    level: str | None = None
    unit: str | None = None
    folder: str = ""
    map_name: str = ""
    title: str = ""
    cells: int = 0


@dataclass(frozen=True)
class EditTask:
    """A task to compute a map with additional obstacles.

    Attributes:
        map_file: The original as `wire.write_dataset` writes it.
        map_name: Name in messages.
        obstacles: Obstacles to add to its building; empty: only prepare the building.
        out: Path of the edited map.
    """

    map_file: str
    map_name: str
    obstacles: tuple[Obstacle, ...]
    out: str


@dataclass(frozen=True)
class Failure:
    """The reason why a job failed.

    Attributes:
        detail: Reason in a sentence.
        ours: Whether the fault is the program's, or the machine's.
        disk_is_full: Whether it is that.
    """

    detail: str
    ours: bool
    disk_is_full: bool = False

    @property
    def error(self) -> Exception:
        """The fault as an exception of the server."""
        return (
            OSError(errno.ENOSPC, self.detail) if self.disk_is_full else RuntimeError(self.detail)
        )


class Worker(ChildProcess):
    """A fresh process of lower priority, without the server's sockets."""

    def __init__(self, work: Callable[[Connection], None]) -> None:
        super().__init__("spawn", _initialize, work)
        with contextlib.suppress(ProcessLookupError):  # it may have been killed by now
            # From the start of the process, since its imports take seconds.
            mine = os.getpriority(os.PRIO_PROCESS, 0)
            os.setpriority(os.PRIO_PROCESS, self.process.pid or 0, min(mine + NICE, 19))


def _initialize(line: Connection, work: Callable[[Connection], None]) -> None:
    """Initialize a worker process and run its tasks."""
    begin_worker()
    with contextlib.suppress(EOFError, BrokenPipeError):
        work(line)


def plans(line: Connection) -> None:
    """Run `PlanTask`s in turn; answer each with its result or a `Failure`."""
    opened: dict[str, AmbiguityMap] = {}

    def planned(task: PlanTask) -> Any:
        return plan(_map_of(task, opened), task)

    while True:
        task: PlanTask = line.recv()
        line.send(_outcome(partial(planned, task)))


def _map_of(task: PlanTask | EditTask, opened: dict[str, AmbiguityMap]) -> AmbiguityMap:
    """Return the map of a task; the last one is kept."""
    if task.map_file not in opened:
        opened.clear()
        opened[task.map_file] = read_map(Path(task.map_file), task.map_name)
    return opened[task.map_file]


def _outcome(work: Callable[[], Any]) -> Any:
    try:
        return work()
    except InputError as error:
        return Failure(str(error), ours=False)
    except Exception as error:
        full = disk_is_full(error)
        if not full:
            traceback.print_exc()
        return Failure(f"{type(error).__name__}: {error}", ours=True, disk_is_full=full)


def plan(amap: AmbiguityMap, task: PlanTask) -> Any:
    """Plan one route or several, and return them in the form of the answer.

    Raises:
        InputError: what the planners refuse.
    """
    planners = load_module(PLANNERS, Path())
    service = AmbiguityService(amap, task.layer, task.weight)
    size = {} if task.radius is None else {"footprint": task.radius}
    robot = planners.RoutePlanner(service, **size)
    how = {"planner_name": task.planner, "seconds": task.seconds, "seed": task.seed}
    if task.weights is None:
        return _route_answers(amap, [robot.plan(task.start, task.goal, **how)], task)[0]
    front = planners.pareto(robot, task.start, task.goal, weights=task.weights, **how)
    answers = _route_answers(amap, [point.route for point in front.points], task)
    return [
        answer | {"weight": point.weight}
        for point, answer in zip(front.points, answers, strict=True)
    ]


def _route_answers(amap: AmbiguityMap, routes: list[Any], task: PlanTask) -> list[dict[str, Any]]:
    """Return routes with their forecasts in the form of the answer."""
    forecasts = route_forecasts(amap, routes, task.odometry, task.localizer)
    return [_plain(route) | forecast for route, forecast in zip(routes, forecasts, strict=True)]


def _plain(route: Any) -> dict[str, Any]:
    """Return a route without its forecast."""
    return {
        "route": route.poses[:, :2].tolist(),
        "theta": route.poses[:, 2].tolist(),
        **{name: getattr(route, name) for name in FIGURES},
    }


class _StoppedError(Exception):
    """The edit was abandoned by its client."""


def edits(line: Connection) -> None:
    """Run `EditTask`s in turn; answer each with None, when it is done, or a `Failure`.

    None that comes meanwhile stops the edit, which is answered too.
    """
    opened: dict[str, AmbiguityMap] = {}

    def report(_: float) -> None:
        if line.poll():
            line.recv()
            raise _StoppedError

    def edited(task: EditTask) -> None:
        amap = _map_of(task, opened)
        with contextlib.suppress(_StoppedError):
            edit(amap, task, report)

    while True:
        task: EditTask | None = line.recv()
        if task is not None:  # else the edit that it should have stopped was done by then
            line.send(_outcome(partial(edited, task)))


def edit(amap: AmbiguityMap, task: EditTask, report: Progress) -> None:
    """Write the map of an edited building.

    Raises:
        InputError: an obstacle cannot be where it is, or the map lacks what an update needs.
    """
    building = amap.environment
    if task.obstacles:
        changed = amap.update(building.edited(add=task.obstacles), progress=report)
        write_dataset(_on_lattice(changed.dataset, amap.dataset), Path(task.out))
        return
    # Prepare the first results, load modules and compile code.
    place = building.free.representative_point()
    amap.update(building.edited(add=[Obstacle.post(place.x, place.y, WARMING)]), progress=report)


def _on_lattice(changed: xr.Dataset, original: xr.Dataset) -> xr.Dataset:
    """Extend a map to the original's lattice; it is smaller where obstacles cover the border."""
    if changed.sizes["x"] == original.sizes["x"] and changed.sizes["y"] == original.sizes["y"]:
        return changed
    empty = {"b": False, "u": NOT_FREE}
    fill = {
        name: empty.get(values.dtype.kind, math.nan) for name, values in changed.data_vars.items()
    }
    axes = {name: original[name] for name in ("x", "y")}
    return changed.reindex(axes, method="nearest", tolerance=SAME, fill_value=fill)


def audits(line: Connection) -> None:
    """Run one `AuditTask`; send (stage, done) during the work, at the end a `Failure` or None."""
    task: AuditTask = line.recv()
    last = 0.0

    def report(stage: str, done: float) -> None:
        nonlocal last
        now = time.monotonic()
        if done in (0.0, 1.0) or now - last >= REPORT_EVERY:
            last = now
            line.send((stage, min(max(done, 0.0), 1.0)))

    line.send(_outcome(partial(_audit, task, report)))


def _audit(task: AuditTask, report: Callable[[str, float], None]) -> None:
    from ambinav.buildings.load import load_environment
    from ambinav.map_building.build import build_map
    from ambinav.studies.audit.advise import advise
    from ambinav.studies.audit.audit import audit
    from ambinav.studies.audit.report import write_audit

    folder = Path(task.folder)
    scanner = RangeScanner.from_yaml_text(task.scanner, file="scanner")
    report("read", 0.0)
    try:
        environment = load_environment(folder / task.map_name, level=task.level, unit=task.unit)
        # Do not reveal the folder of uploads.
        environment.name, environment.source = task.title, Path(task.map_name)
        environment.notes = tuple(_without_folder(folder, note) for note in environment.notes)
        _check_size(environment.bounds, scanner, task)
        report("map", 0.0)
        amap = build_map(
            environment,
            scanner,
            spacing=task.spacing,
            radius=task.radius,
            headings=task.headings,
            progress=lambda done: report("map", done),
            store=False,  # buildings of strangers are not kept
        )
        report("report", 0.0)
        result = audit(amap, environment, scanner)
        write_audit(advise(result), folder / "report", progress=lambda done: report("report", done))
    except InputError as error:
        message = _without_folder(folder, str(error))
        # What are options of a command line are fields here.
        raise InputError(re.sub(r"--(level|unit)\b", r"the field \1", message)) from None
    write_dataset(amap.dataset, folder / "map.npz")


def _without_folder(folder: Path, text: str) -> str:
    """Remove a folder's path from a text, so that its files appear by name only."""
    return text.replace(f"{folder}{os.sep}", "")


def _check_size(
    bounds: tuple[float, float, float, float], scanner: RangeScanner, task: AuditTask
) -> None:
    from ambinav.map_building.build import HEADINGS

    xmin, ymin, xmax, ymax = bounds
    headings = task.headings or (1 if scanner.looks_all_around else HEADINGS)
    cells = (xmax - xmin) * (ymax - ymin) / task.spacing**2 * headings
    if cells > task.cells:
        raise InputError(
            f"spacing is {task.spacing:g} m, which makes {cells:.3g} cells of this building; this "
            f"server takes {task.cells:.3g}: give a larger one."
        )
