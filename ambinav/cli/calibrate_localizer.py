"""`ambinav calibrate localizer`: make the forecasts of a localizer from its own drives."""

from __future__ import annotations

import json
import reprlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final

import typer

from ambinav.cli import options
from ambinav.cli.limits import Count, Natural, at_least
from ambinav.cli.map_options import BuildingOptions, Spacing, check_with_map
from ambinav.cli.printing import show, table
from ambinav.cli.running import check_apart, check_file, progress_bars, reporting, resumable
from ambinav.runtime.errors import InputError
from ambinav.runtime.packages import ENVIRONMENTS, need

if TYPE_CHECKING:
    from ambinav.forecasting.localizer_class import LocalizerClass
    from ambinav.forecasting.localizer_study import StudiedRoutes
    from ambinav.forecasting.study_drives import StudySettings
    from ambinav.geometry.environment import Environment

SUITES: Final = ("hall", "corridor", "office", "warehouse", "loop", "procedural")
"""Suites of which buildings are drawn if none is given."""
ODOMETRIES: Final = ("good", "mediocre", "poor")
YAML: Final = (".yaml", ".yml")
KEPT: Final = ".drives"
"""Ending of the file beside the output that keeps the drives of an interrupted run."""


@dataclass(frozen=True, kw_only=True)
class DrivenBuildings:
    """Options on the buildings that robots drive in.

    Attributes:
        map_file (FILE): Drive in this building; repeatable. Five or more do without drawn ones.
        suite (NAME): Draw buildings of this suite (see `ambinav plugins`); repeatable. [default:
            hall, corridor, office, warehouse, loop and procedural; none with --map]
        buildings (N): Number of buildings that are drawn of each suite.
    """

    PANEL: ClassVar[str] = "Buildings"

    map_file: Annotated[list[Path] | None, typer.Option("--map")] = None
    suite: list[str] | None = None
    buildings: Count = 4

    def load(self, reading: BuildingOptions) -> dict[str, Environment]:
        """Load and draw the buildings, by name.

        Raises:
            InputError: one cannot be used, or there is no such suite.
        """
        files = {str(path): reading.load(path) for path in self.map_file or ()}
        suites = self.suite or (() if files else SUITES)
        if not suites:
            return files
        need("drawing buildings", ENVIRONMENTS)
        from ambinav_envs.buildings.suites import suite

        chosen = [suite(name) for name in dict.fromkeys(suites)]
        numbers = range(1, self.buildings + 1)
        return files | {
            f"{entry.name}-{number}": entry.building(number)
            for number in numbers
            for entry in chosen
        }


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """Options on the drives.

    Attributes:
        odometry (NAME): Odometry of the robots, as for `ambinav forecast`; repeatable. [default:
            good, mediocre and poor]
        routes (N): Number of routes in each building.
        runs (N): Number of robots that drive each route with each scanner.
        seed (N): Seed of routes and drives.
    """

    PANEL: ClassVar[str] = "Drives"

    odometry: list[str] | None = None
    routes: Count = 8
    runs: Annotated[int, at_least(2)] = 32
    seed: Natural = 0
    spacing: Spacing = 0.1

    def settings(self, scanners: list[str]) -> StudySettings:
        """Return the settings of the study.

        Raises:
            InputError: a scanner or an odometry is unknown, or a number is out of its range.
        """
        from ambinav.drive.odometries import odometry_of
        from ambinav.forecasting.study_drives import StudySettings
        from ambinav.sensing.scanner import RangeScanner

        try:
            odometries = {name: odometry_of(name) for name in self.odometry or ODOMETRIES}
        except InputError as error:
            raise InputError(f"--odometry: {error}") from None
        return StudySettings(
            scanners={name: RangeScanner.load(name) for name in scanners}, odometries=odometries,
            routes=self.routes, runs=self.runs, spacing=self.spacing, seed=self.seed,
        )  # fmt: skip


@options.documented
def localizer(
    name: Annotated[str, typer.Argument()],
    scanner: Annotated[
        list[str], typer.Option("--scanner", "-s", autocompletion=options.complete_preset)
    ],
    output: Annotated[Path, typer.Option("--output", "-o")],
    *,
    buildings: DrivenBuildings,
    drives: DriveOptions,
    building: BuildingOptions,
    as_json: options.AsJson = False,
) -> None:
    """Drive a localizer in many buildings, and fit forecasts to how often it gets lost.

    The file that it writes is a class of localizer for `ambinav forecast --localizer FILE` and
    `ambinav plan --localizer FILE`. An interrupted run keeps its drives beside the output.

    Example: `ambinav calibrate localizer amcl --scanner turtlebot3-lds -o amcl.yaml`

    Parameters:
        name (NAME|FILE): A localizer (see `ambinav plugins`), or a YAML file with its type and
            parameters as in a scenario.
        scanner (PRESET|FILE): A preset (see `ambinav presets`) or a scanner .yaml file; repeatable.
        output (FILE): Class file to write, .yaml.
    """
    with reporting():
        check_with_map(buildings.map_file, building)
        if output.suffix not in YAML:
            raise InputError(
                f"--output: {output} is not a .yaml file; give e.g. {Path(name).stem}-class.yaml."
            )
        check_file(output)
        check_apart(output, name, *scanner, *(buildings.map_file or ()))
        from ambinav.forecasting.kept_drives import KeptDrives
        from ambinav.forecasting.localizer_study import study_localizer

        begin = _uncalibrated(name)
        settings = drives.settings(scanner)
        places = buildings.load(building)
        drives_file = output.with_name(output.name + KEPT)
        kept_drives = KeptDrives(drives_file)
        with resumable(drives_file, "the drives so far are"), progress_bars(as_json) as bars:
            studied = study_localizer(
                begin, places, settings, kept=kept_drives, progress=bars("drives")
            )
        studied.localizer.to_yaml(output)
        kept_drives.remove()
        if as_json:
            typer.echo(json.dumps(_document(studied, output), indent=2))
        else:
            _show(studied, output)


def _uncalibrated(name: str) -> LocalizerClass:
    """Return the class to begin with of the localizer that the argument names.

    Raises:
        InputError: there is no such localizer, or the file cannot be used.
    """
    from ambinav.config import parse_yaml, read_text
    from ambinav.forecasting.localizer_study import uncalibrated

    path = Path(name)
    if path.suffix not in YAML:
        from ambinav.forecasting.localizer_class import LocalizerClass, localizer_classes

        # A class's name may be none of a localizer's, as of `product`: it says what it drives.
        is_class = name in localizer_classes()
        return uncalibrated(name, LocalizerClass.load(name).localizer if is_class else name)
    plain: Any = parse_yaml(read_text(path), str(path), "give a mapping with the key type")
    if not isinstance(plain, Mapping) or "type" not in plain:
        raise InputError(f"{path} holds {reprlib.repr(plain)}; give a mapping with the key type.")
    try:
        return uncalibrated(path.stem, plain)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _show(studied: StudiedRoutes, output: Path) -> None:
    rows = [
        [
            row["scanner"], f"{row['routes']}", f"{100.0 * row['lost']:.1f} %",
            f"{100.0 * row['forecast']:.1f} %",
        ]
        for row in _rows(studied)
    ]  # fmt: skip
    fitted = studied.calibration
    show(table(("scanner", "routes", "lost", "forecast"), rows, left=("scanner",)))
    show(
        "",
        f"Brier skill in {studied.buildings} buildings, each forecast by a fit without it: "
        f"{fitted.skill_text}.",
    )
    if not fitted.skill.low > 0.0:
        show(
            "Forecasts are not shown to be better than the average of all routes; drive more "
            "routes, in buildings and with odometries that lose some of the robots."
        )
    show(f"class: {output}")


def _rows(studied: StudiedRoutes) -> list[dict[str, Any]]:
    """Return routes, lost share and mean forecast without the route's building, by scanner."""
    rows = []
    for scanner in dict.fromkeys(studied.scanners):
        part = [name == scanner for name in studied.scanners]
        rows.append(
            {
                "scanner": scanner,
                "routes": sum(part),
                "lost": float(studied.lost[part].mean()),
                "forecast": float(studied.calibration.left_out[part].mean()),
            }
        )
    return rows


def _document(studied: StudiedRoutes, output: Path) -> dict[str, Any]:
    """Return the outcome as plain data; shares and skills from 0 to 1."""
    skill, fitted = studied.calibration.skill, studied.localizer
    return {
        "output": str(output),
        "localizer": fitted.name,
        "made": fitted.made,
        "buildings": studied.buildings,
        "scanners": _rows(studied),
        "skill": {"value": skill.value, "low": skill.low, "high": skill.high},
        "ceiling": studied.calibration.ceiling,
    }
