"""Audits of all sites for all scanners, in processes of this computer or on a cluster."""

from __future__ import annotations

import contextlib
import shutil
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from ambinav.map_building.same_code import do_all
from ambinav.map_building.stored import computing_digest
from ambinav.maps.address import Address
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.fleet.batch import Batch
from ambinav.studies.fleet.catalogue import ITEMS
from ambinav.studies.fleet.document import FleetDocument, RunPart
from ambinav.studies.fleet.report import STUDY, fleet_document, write_report
from ambinav.studies.fleet.site import Site
from ambinav.studies.fleet.sites import safe_name
from ambinav.studies.fleet.unit import RESULTS, FleetSettings, FleetWork, Unit, UnitDone
from ambinav.tiles.claim import claimed

MOST_DEATHS: Final = 3
"""Number of killed workers after which a site counts as failed."""
OPTION: Final = "--dask"


@dataclass(frozen=True)
class Fleet:
    """Result of a run."""

    document: FleetDocument
    results: tuple[UnitDone, ...]

    @property
    def made(self) -> int:
        """Number of results that were made now; the others were there."""
        return sum(done.was_made for done in self.results)

    @property
    def failed(self) -> tuple[UnitDone, ...]:
        """Those without figures."""
        return tuple(done for done in self.results if done.result.status == "failed")


def units_of(sites: Sequence[Site], scanners: Sequence[str]) -> tuple[Unit, ...]:
    """Return the units of a fleet, by site and name of the scanner.

    Args:
        sites: The sites.
        scanners: Presets or scanner files, for sites that name none.

    Raises:
        InputError: one cannot be used, two have the same name, or a site has none.
    """
    loaded: dict[str, tuple[str, RangeScanner]] = {}
    labels: dict[str, str] = {}

    def load(named: str, folder: str) -> tuple[str, RangeScanner]:
        beside = Path(folder, named)
        place = str(beside) if folder and beside.is_file() else named
        if Path(place).is_file():
            place = str(Path(place).resolve())
        if place not in loaded:
            scanner = RangeScanner.load(place)
            label = safe_name(Path(place).stem if Path(place).is_file() else place)
            if labels.setdefault(label, place) != place:
                raise InputError(
                    f"--scanner: {labels[label]} and {place} are both called {label} in the "
                    "results; rename a file."
                )
            loaded[place] = (label, scanner)
        return loaded[place]

    common = [
        *dict(sorted((load(named, "") for named in scanners), key=lambda pair: pair[0])).items()
    ]
    units = []
    for site in sites:
        try:
            site_scanners = [load(site.scanner, site.folder)] if site.scanner else common
        except InputError as error:
            raise InputError(f"site {site.name!r}: {error}") from None
        if not site_scanners:
            raise InputError(f"--scanner: site {site.name!r} has none; give one or more.")
        units += [Unit(site, label, scanner) for label, scanner in site_scanners]
    return tuple(units)


def run_fleet(
    units: Sequence[Unit],
    output: str | Path,
    settings: FleetSettings,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = silent,
) -> Fleet:
    """Audit all units that have no result yet, and write tables, catalogue and page.

    If it is interrupted, the same call resumes it. The files written depend neither on the order
    of the units nor on the number of workers, but for `Result.run`.

    Args:
        units: What to audit, see `units_of`.
        output: Folder, or URL that fsspec knows.
        settings: Settings of the audits.
        workers: Number of processes; 0: only this one, with its threads; None: one per processor.
        scheduler: Address of a Dask scheduler, whose workers audit instead. They must reach the
            buildings and `output` under the same names.
        progress: Called with the share done.

    Raises:
        InputError: nothing can be written, another run is at work there, something else is there,
            or the scheduler does not answer.
    """
    address = _place(output)
    with _locked(address):
        results = _run_units(
            units, FleetWork(address, settings, computing_digest()), workers, scheduler, progress
        )
        report = fleet_document(results, settings)
        write_report(report, results, address)
    return Fleet(report, results)


def run_batch(
    units: Sequence[Unit],
    output: str | Path,
    settings: FleetSettings,
    batch: Batch,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Progress = silent,
) -> tuple[UnitDone, ...]:
    """Audit one part of the units, and write their results only.

    Machines that share nothing but the output audit a part each, at the same time. `run_fleet` of
    all units then finds their results there, makes those that are missing, and writes the rest.

    Args:
        units: All units of the fleet, in any order.
        output: Folder, or URL that fsspec knows, the same for all parts.
        settings: Settings of the audits.
        batch: The part.
        workers: Number of processes, see `run_fleet`.
        scheduler: Address of a Dask scheduler, see `run_fleet`.
        progress: Called with the share of the part that is done.

    Returns:
        The part's results.

    Raises:
        InputError: the part is empty; or as `run_fleet`.
    """
    part = batch.of(units)
    if not part:
        raise InputError(
            f"--batch: {batch} is empty, as there are only {len(units)} audits; take fewer parts."
        )
    address = _place(output)
    with _locked(address, batch):
        work = FleetWork(address, settings, computing_digest())
        return _run_units(part, work, workers, scheduler, progress)


def _place(output: str | Path) -> Address:
    address = Address.of(output)
    if address.folder is not None:
        address = Address.of(STUDY.folder.check(address.folder).absolute())
    return address


def _run_units(
    units: Sequence[Unit], work: FleetWork, workers: int | None, scheduler: str | None,
    progress: Progress,
) -> tuple[UnitDone, ...]:  # fmt: skip
    """Do the work for all units; return the results by site and scanner."""
    queue = FleetQueue(work, deque(units), progress, len(units))
    do_all(queue, work, work.computed_by, workers, scheduler, OPTION)
    return tuple(done for _, done in sorted(queue.results.items()))


@dataclass(eq=False)
class FleetQueue:
    """Queue of units; one whose workers are killed again and again fails.

    Attributes:
        work: The work.
        units: Those that are left.
        report: Called with the share done.
        total: Number of all units.
        results: What is done, by site and scanner.
    """

    work: FleetWork
    units: deque[Unit]
    report: Progress
    total: int
    results: dict[tuple[str, str], UnitDone] = field(default_factory=dict)
    _deaths: Counter[str] = field(default_factory=Counter)

    def take(self) -> Unit | None:
        """Return the next unit; None: none is left now, but units under way may come back."""
        return self.units.popleft() if self.units else None

    def give(self, done: UnitDone) -> None:
        """Record the result of a unit."""
        self.results[done.result.site, done.result.scanner] = done
        self.report(len(self.results) / self.total)

    def lost(self, task: Unit, *, often: bool = False) -> None:
        """Queue a unit again, as its worker was killed; after `MOST_DEATHS` it has failed."""
        self._deaths[task.file] += 1
        if not often and self._deaths[task.file] < MOST_DEATHS:
            self.units.append(task)
            return
        reason = (
            "the workers that audited it were killed again and again, perhaps for lack of memory; "
            "fewer --workers or a wider --spacing need less."
        )
        run = RunPart(
            created=datetime.now(UTC).isoformat(timespec="seconds"), seconds=0.0, peak_memory_mb=0.0
        )
        result = task.result("", run, reason)
        self.work.write(task, result, b"")
        self.give(UnitDone(result, b"", task.site.moment, True))


@contextlib.contextmanager
def _locked(address: Address, batch: Batch | None = None) -> Iterator[None]:
    """Hold the output for this run; that of the whole removes the leftovers of killed ones.

    Parts may be at work beside each other.
    """
    if address.folder is None:
        address.check_writable()
        system, root = address.files
        part = f"-{batch.number}-of-{batch.count}" if batch else ""
        with claimed(system, f"{root}{part}", address.place):
            yield
        return
    with STUDY.folder.hold(address.folder, shared=batch is not None):
        if batch is None:
            for folder in (RESULTS, ITEMS):
                # Names of sites do not begin with a dot.
                for path in [*(address.folder / folder).rglob(".*")]:
                    shutil.rmtree(path, ignore_errors=True)
        yield
