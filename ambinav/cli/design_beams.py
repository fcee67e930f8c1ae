"""`ambinav design beams`: the fewest beams whose maps stay within a stated loss."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.checks import check_planar, conflict
from ambinav.cli.limits import Count, Natural
from ambinav.cli.map_options import (
    AmbiguityRadius,
    BuildingOptions,
    MapStd,
    RobotRadius,
    Spacing,
    check_radius,
)
from ambinav.cli.printing import finish, show, table
from ambinav.cli.region_options import RegionOptions, check_one
from ambinav.cli.running import check_report, progress_bars, reporting
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.sensing.scanner import RangeScanner
    from ambinav.studies.design.beams.document import Document
    from ambinav.studies.design.beams.sample import MapSample
    from ambinav.studies.design.region import Region

MOST_BYTES = 4e9
"""Most bytes of memory for the returns of the beams."""


@dataclass(frozen=True, kw_only=True)
class SampleOptions(RegionOptions):
    """Options on the region and density of the poses on which subsets are compared.

    Attributes:
        places (N): Places of each map for the selection; as many others are held out to check it.
        seed (N): Seed of the sampled places and of the search.
    """

    PANEL: ClassVar[str] = "Places"

    places: Count = 800
    spacing: Spacing = 0.2
    radius: AmbiguityRadius = 0.5
    map_std: MapStd = None
    robot_radius: RobotRadius = None
    seed: Natural = 1

    def check(self, maps: int) -> None:
        """Check what can be checked before a building is read.

        Raises:
            InputError: an option has a value that cannot be used.
        """
        check_radius(self.radius, self.spacing)
        check_one(self.polygon, self.route)
        for option, path in (("--polygon", self.polygon), ("--route", self.route)):
            if path is not None and maps > 1:
                raise InputError(
                    f"{option}: {path} lies in one building, but {maps} maps are given; give one."
                )


@dataclass(frozen=True, kw_only=True)
class MessageOptions:
    """Options on the laser's messages, for laser_filters.yaml.

    Attributes:
        frames (NAME): frame_id of the messages; once for each planar laser, in the scanner's order.
            [default: laser, laser2 ...]
        angle_min (DEG): Direction of a full circle's first reading, degrees from the laser's axis.
            [default: -180]
    """

    PANEL: ClassVar[str] = "LaserScan messages"

    frames: Annotated[list[str] | None, typer.Option("--frame")] = None
    angle_min: float | None = None

    def check(self, scanner: RangeScanner) -> None:
        """Check the angle, and that there is one name at most for each laser.

        Raises:
            InputError: the angle is no direction, or the scanner has not that many lasers.
        """
        from ambinav.studies.design.beams.scanner import planar_lasers

        lasers, names = planar_lasers(scanner).values(), self.frames or []
        if len(names) > len(lasers):
            raise InputError(
                f"--frame: there are {len(names)} names, and {scanner.name!r} has {len(lasers)} "
                "planar lasers; give at most one name for each."
            )
        for name in names:
            if names.count(name) > 1:
                raise InputError(
                    f"--frame: {name!r} is given twice; give each laser's messages their own name."
                )
        conflict(
            "--angle-min",
            self.angle_min is not None and not any(fan.full_circle for fan in lasers),
            f"is for lasers that look all around, and {scanner.name!r} has none",
        )
        if self.angle_min is not None and not -360.0 <= self.angle_min <= 360.0:
            raise InputError(
                f"--angle-min: {self.angle_min:g} is out of range; give degrees from -360 to 360, "
                "e.g. 0."
            )


@options.documented
def beams(
    map_files: Annotated[list[Path], typer.Argument()],
    scanner: options.Scanner,
    output: Annotated[Path, typer.Option("--output", "-o")],
    loss: float = 5.0,
    *,
    building: BuildingOptions,
    sampled: SampleOptions,
    messages: MessageOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
) -> None:
    """Find the fewest beams that keep the maps of all beams within a given loss.

    Greedy subsets are compared with evenly spaced subsets of the same size; if they are equal, the
    evenly spaced one is selected. Writes the report, scanner.yaml with the selected beams, and
    laser_filters.yaml, which removes the other beams from a running laser's messages (ROS 2).

    Example: `ambinav design beams office.yaml lab.yaml --scanner rplidar-a1 --loss 5 -o fewer`

    Parameters:
        map_files (MAP...): Buildings: map_server .yaml, .geojson, .wkt, .ifc or .dxf files.
        output (DIR): Folder for the report; an earlier one there is replaced.
        loss (POINTS): Largest change allowed on any map: of each zone's share of the floor, in
            percentage points, and of 100 times the mean difference of the level.
    """
    with reporting():
        from ambinav.sensing.scanner import RangeScanner
        from ambinav.studies.design.beams.choose import check_beams, check_limit, choose
        from ambinav.studies.design.beams.document import document
        from ambinav.studies.design.beams.report import STUDY, write_report

        check_limit(loss, "--loss")
        sampled.check(len(map_files))
        check_report(STUDY, output, pictures)
        full = RangeScanner.load(scanner)
        messages.check(full)
        check_planar(full)
        check_beams(full)
        import numpy as np

        region = sampled.region()
        _check_memory(sampled, full, len(map_files))
        buildings = [building.load(path) for path in map_files]
        with progress_bars(as_json) as bars:
            drawn = _draw(buildings, full, sampled, region, bars("beams cast"))
            samples, checks = ([pair[k] for pair in drawn] for k in (0, 1))
            rng = np.random.default_rng([sampled.seed, len(buildings)])
            choice = choose(full, samples, checks, loss, rng, bars("search"))
        from ambinav.studies.design.beams.localizer import scan_information_of, update_times
        from ambinav.studies.design.beams.scanner import scan_masks, subset_scanner

        subset = subset_scanner(full, choice.chosen.beams)
        masks = scan_masks(full, choice.chosen.beams, messages.frames or (), messages.angle_min)
        report = document(
            choice,
            samples,
            [str(path) for path in map_files],
            update_times(buildings[0], full, subset, rng),
            scan_information_of(buildings, full, subset, sampled.seed, sampled.map_std),
            masks,
            _parameters(sampled, region, samples),
        )
        report = write_report(choice, report, masks, output, pictures)
        finish(report, lambda report: _show(report, output), as_json=as_json)


def _check_memory(sampled: SampleOptions, scanner: RangeScanner, maps: int) -> None:
    """Check that the returns of all beams at the places and around them fit into memory.

    Raises:
        InputError: it takes more than `MOST_BYTES`.
    """
    from ambinav.ambiguity.neighbourhoods import disc

    # Five float32 a beam, two samples a map.
    about = len(disc(sampled.radius, sampled.spacing))
    place = 2 * maps * about * 5 * 4 * scanner.beams
    if place * sampled.places > MOST_BYTES:
        max_places = max(int(MOST_BYTES / place), 1)
        raise InputError(
            f"--places: {sampled.places} places of {maps} maps take "
            f"{place * sampled.places / 1e9:.1f} GB with the {scanner.beams} beams of "
            f"{scanner.name!r}; give at most {max_places}, or a wider --spacing."
        )


def _draw(
    buildings: list[Environment],
    scanner: RangeScanner,
    sampled: SampleOptions,
    region: Region,
    progress: Progress,
) -> list[tuple[MapSample, ...]]:
    """Draw two samples of each building."""
    from ambinav.geometry.collision.reach import ROBOT_RADIUS, find_reach
    from ambinav.studies.design.beams.sample import draw_samples, rng_of

    radius = sampled.robot_radius or scanner.robot_radius or ROBOT_RADIUS
    drawn = []
    for number, env in enumerate(buildings):
        drawn.append(
            draw_samples(
                env,
                scanner,
                sampled.places,
                rng_of(env, sampled.seed, "places"),
                spacing=sampled.spacing,
                radius=sampled.radius,
                map_std=sampled.map_std,
                region=region,
                reach=find_reach(env, radius),
            )
        )
        progress((number + 1) / len(buildings))
    return drawn


def _parameters(sampled: SampleOptions, region: Region, samples: list[MapSample]) -> dict[str, Any]:
    """Return the parameters of the search as the report lists them."""
    parameters = {name: value for name, value in asdict(sampled).items() if value is not None}
    parameters.pop("polygon", None)
    parameters.pop("route", None)
    return {**parameters, "region": region.title, "tau with all beams": samples[0].model.tau}


def _show(report: Document, output: Path) -> None:
    losses = (
        (part.name, f"{part.checked.zones_points:.2f}", f"{part.checked.level_points:.2f}")
        for part in report.maps
    )
    columns = "map", "zones, points", "level, points"
    show(report.summary, "", table(columns, losses, left=("map",)))
    files = (*report.files, "report.html")
    show(*(f"{name.partition('.')[0]}: {output / name}" for name in files), wrap=False)
