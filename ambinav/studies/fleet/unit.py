"""A unit of a fleet's work: the audit of one site for one scanner."""

from __future__ import annotations

import resource
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from ambinav.buildings.load import load_environment
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.address import Address
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of
from ambinav.sensing.robot_radius import robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.audit.advise import advise
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.document import document
from ambinav.studies.fleet.document import Result, RunPart
from ambinav.studies.fleet.site import Site
from ambinav.studies.fleet.thumbnail import thumbnail

RESULTS: Final = "results"
"""Folder of the results in the output."""


@dataclass(frozen=True)
class FleetSettings:
    """Settings of all audits of a fleet.

    Attributes:
        spacing: Spacing of the maps, metres.
        radius: Radius within which scans are compared, metres.
        robot_radius: Radius of the robot, metres; None: each scanner's own.
        advice: Whether each audit has a verdict: it takes most of the time.
    """

    spacing: float = 0.1
    radius: float = 0.5
    robot_radius: float | None = None
    advice: bool = True


@dataclass(frozen=True)
class Unit:
    """A site and a scanner.

    Attributes:
        site: The site.
        label: Name of the scanner in results: the preset, or the file without suffix.
        scanner: The scanner.
    """

    site: Site
    label: str
    scanner: RangeScanner

    @property
    def file(self) -> str:
        """Path of its result in the output, without suffix."""
        return f"{RESULTS}/{self.site.name}/{self.label}"

    def result(self, digest: str, run: RunPart, error: str = "", **figures: Any) -> Result:
        """Return its result; with an error, that of a failure."""
        return Result(
            site=self.site.name, scanner=self.label, building=self.site.building, digest=digest,
            status="failed" if error else "done", error=error, run=run, **figures,
        )  # fmt: skip


@dataclass(frozen=True)
class UnitDone:
    """A unit after its work.

    Attributes:
        result: The result.
        picture: PNG of the floor; empty if it failed.
        moment: Date of the site, see `Site.moment`.
        was_made: Whether it was made now.
    """

    result: Result
    picture: bytes
    moment: str
    was_made: bool


@dataclass(frozen=True)
class FleetWork:
    """Audits sites; a result that is there and was made of the same is kept.

    Attributes:
        output: Where results are written.
        settings: Settings of the audits.
        computed_by: Digest of the code, see `computing_digest`.
    """

    output: Address
    settings: FleetSettings
    computed_by: str

    def __call__(self, unit: Unit) -> UnitDone:
        """Audit a site for a scanner, and write the result; what fails is a result too.

        Raises:
            InputError: nothing can be written.
        """
        start, digest = time.perf_counter(), ""
        try:
            contents = unit.site.contents()
            digest = digest_of(
                self.computed_by, self.settings, contents, dict(unit.site.reading),
                unit.site.building, unit.label, unit.scanner,
            )  # fmt: skip
            stored = self._stored_result(unit, digest)
            if stored is not None:
                return stored
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                result, picture = self._audited(unit, contents, digest, start)
        except InputError as error:
            result, picture = unit.result(digest, _run(start), str(error)), b""
        # Whatever a reader or a plug-in raises: the other sites go on.
        except Exception as error:
            reason = f"internal error, please report it: {type(error).__name__}: {error}"
            result, picture = unit.result(digest, _run(start), reason), b""
        self.write(unit, result, picture)
        return UnitDone(result, picture, unit.site.moment, True)

    def write(self, unit: Unit, result: Result, picture: bytes) -> None:
        """Write a result, its picture first: where the result is, all is.

        Raises:
            InputError: nothing can be written.
        """
        if picture:
            self.output.write(f"{unit.file}.png", picture)
        text = result.model_dump_json(indent=1) + "\n"
        self.output.write(f"{unit.file}.json", text.encode())

    def _stored_result(self, unit: Unit, digest: str) -> UnitDone | None:
        """Return the result that is there, if it was made of the same and did not fail."""
        content = self.output.read(f"{unit.file}.json")
        if content is None or digest.encode() not in content:
            return None
        try:
            result = Result.model_validate_json(content)
        except ValidationError:  # a file system that does not write completely or not at all
            return None
        picture = self.output.read(f"{unit.file}.png")
        if result.status == "failed" or result.digest != digest or not picture:
            return None
        return UnitDone(result, picture, unit.site.moment, False)

    def _audited(
        self, unit: Unit, contents: dict[str, bytes], digest: str, start: float
    ) -> tuple[Result, bytes]:
        scanner, settings = unit.scanner, self.settings
        environment = _load(unit.site, contents)
        reach = find_reach(environment, settings.robot_radius or robot_radius(scanner))
        amap = build_map(
            environment, scanner, spacing=settings.spacing, radius=settings.radius, store=False
        ).for_robot(reach)
        audited = audit(amap, environment, scanner, reach=reach)
        if settings.advice:
            audited = advise(audited, posts=0)
        report = document(audited)
        # Without pictures, and the same wherever and whenever it is made.
        places = tuple(place.model_copy(update={"picture": ""}) for place in report.places)
        building = report.environment.model_copy(update={"source": unit.site.building})
        report = report.model_copy(
            update={"created": "", "pictures": (), "places": places, "environment": building}
        )
        result = unit.result(
            digest, _run(start), audit=report, mean_level=_mean_level(audited.amap)
        )
        return result, thumbnail(audited.amap)


def _load(site: Site, contents: dict[str, bytes]) -> Environment:
    """Read the building; one at a URL from copies of its files.

    Raises:
        InputError: it cannot be used; the message names the site's file.
    """
    home, name = site.home
    if home.folder is not None:
        return load_environment(home.folder / name, **site.reading)
    with tempfile.TemporaryDirectory(prefix="ambinav-") as folder:
        for each, content in contents.items():
            path = Path(folder, each)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        try:
            return load_environment(Path(folder, name), **site.reading)
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}/{name}", site.building)) from error


def _mean_level(amap: AmbiguityMap) -> float | None:
    level = amap.floor("level", "mean").values[amap.judged.counted]
    return float(level.mean(dtype=float)) if level.size else None


def _run(start: float) -> RunPart:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss  # kibibytes; macOS: bytes
    return RunPart(
        created=datetime.now(UTC).isoformat(timespec="seconds"),
        seconds=time.perf_counter() - start,
        peak_memory_mb=peak * (1e-6 if sys.platform == "darwin" else 1.024e-3),
    )
