"""Groups of options on a building, on the map that is made of it, and on the floor that counts."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.running import Progress, above_zero, not_negative, note
from ambinav.errors import InputError

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner

LONG_SECONDS = 60.0
"""A map that takes longer is announced."""
LARGE_BYTES = 4e9
"""A map that takes more memory is announced."""


@dataclass(frozen=True, kw_only=True)
class BuildingOptions:
    """How the file of a building is to be read."""

    PANEL: ClassVar[str] = "Building"

    level: Annotated[
        str | None,
        typer.Option(
            "--level",
            metavar="NAME|INDEX",
            help="The floor of a plan whose features have several levels.",
            show_default="the only one",
        ),
    ] = None
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            metavar="m|cm|mm",
            help="What a drawn plan's coordinates are in.",
            show_default="metres, where they make a building",
        ),
    ] = None

    def check(self, map_file: object) -> None:
        """Check that they come with a building, where that is an option too.

        Raises:
            InputError: they come without.
        """
        for option, value in (("--level", self.level), ("--unit", self.unit)):
            if value is not None and not map_file:
                raise InputError(
                    f"{option}: {value!r} says something of a plan; give it with --map."
                )


@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """What is computed of the building, and how finely."""

    PANEL: ClassVar[str] = "Map"

    spacing: Annotated[
        float, typer.Option("--spacing", metavar="M", help="Distance between map cells, metres.")
    ] = 0.1
    radius: Annotated[
        float,
        typer.Option(
            "--ambiguity-radius",
            metavar="M",
            help="How far around a pose its scan is compared with others, metres.",
        ),
    ] = 0.5
    headings: Annotated[
        int | None,
        typer.Option(
            "--headings",
            metavar="N",
            help="Number of headings that the map has.",
            show_default="the scanner decides",
        ),
    ] = None
    map_std: Annotated[
        float | None,
        typer.Option(
            "--map-std",
            metavar="M",
            help="Standard deviation of the walls in the map, metres.",
            show_default="0.03 for occupancy maps, 0.02 for drawings",
        ),
    ] = None
    layers: Annotated[
        str | None,
        typer.Option(
            "--layers",
            metavar="NAMES",
            help="Further layers, e.g. fisher,gfm; all: those that the scanner can have, but "
            "aliasing.",
            show_default="none",
        ),
    ] = None
    no_store: options.NoStore = False

    def check(self) -> None:
        """Check what can be checked before the building is read.

        Raises:
            InputError: an option has a value that cannot be used.
        """
        above_zero(self.spacing, "--spacing", "0.1")
        above_zero(self.radius, "--ambiguity-radius", "0.5")
        not_negative(self.map_std, "--map-std", "0.05")
        if self.headings is not None and self.headings < 1:
            raise InputError(
                f"--headings: {self.headings} is not a number of headings; give 1 or more."
            )

    def load(
        self, map_file: Path, scanner: str, building: BuildingOptions
    ) -> tuple[Environment, RangeScanner]:
        """Load the building and the scanner, the scanner first: it is the quicker to be wrong.

        Raises:
            InputError: one cannot be used, the spacing exceeds the building, or there is no layer
                of a name or not for the scanner.
        """
        from ambinav.geometry.io.load import load_environment
        from ambinav.sensing.presets import preset_names
        from ambinav.sensing.scanner import RangeScanner

        chosen = RangeScanner.load(scanner)
        self._names(chosen)
        if str(map_file) in preset_names():
            raise InputError(
                f"{map_file}: this is a scanner preset, not a building; give it with --scanner."
            )
        environment = load_environment(map_file, level=building.level, unit=building.unit)
        xmin, ymin, xmax, ymax = environment.bounds
        if self.spacing > max(xmax - xmin, ymax - ymin):
            raise InputError(
                f"--spacing: {self.spacing:g} m is larger than the building in {map_file} "
                f"({xmax - xmin:.3g} x {ymax - ymin:.3g} m); give less, e.g. 0.1."
            )
        return environment, chosen

    def announce(self, environment: Environment, scanner: RangeScanner) -> None:
        """Say on stderr, before a map that takes long is begun, how long and how much memory.

        And what a wider spacing would make of it.
        """
        from ambinav.ambiguity.estimate import coarser, estimate

        spacing, radius = self.spacing, self.radius
        if not 0.0 < spacing <= radius:
            return  # which `build_map` refuses
        needs = estimate(environment, scanner, spacing, radius, self.headings)
        if needs.seconds < LONG_SECONDS and needs.bytes < LARGE_BYTES:
            return
        wider = coarser(environment, scanner, spacing, radius, self.headings, LONG_SECONDS)
        remedy = "" if wider is None else f"; with --spacing {wider.spacing:g} {wider}"
        if needs.bytes > os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"):
            remedy = f", more than this computer has{remedy}"
        besides = "" if self.layers is None else ", the further layers not counted"
        headed = "" if needs.headings == 1 else f" with {needs.headings} headings"
        millions = needs.poses / 1e6
        poses = f"{millions:.0f}" if millions >= 10.0 else f"{millions:.2g}"
        note(
            f"this map takes {needs} ({poses} million poses{headed}, each compared with "
            f"{needs.neighbours:.0f} others by {needs.beams} beams{besides}){remedy}."
        )

    def build(
        self,
        environment: Environment,
        scanner: RangeScanner,
        progress: Progress,
        robot_radius: float = 0.0,
    ) -> AmbiguityMap:
        """Open the map from the store, or announce, build and keep it.

        Raises:
            InputError: an option does not suit this building, or see `MapStore.of_user`.
        """
        from ambinav.ambiguity.build import build_map

        return build_map(
            environment,
            scanner,
            spacing=self.spacing,
            radius=self.radius,
            headings=self.headings,
            map_std=self.map_std,
            progress=progress,
            layers=self._names(scanner),
            robot_radius=robot_radius,
            store=options.store_of(self.no_store, lambda: self.announce(environment, scanner)),
        )

    def _names(self, scanner: RangeScanner) -> tuple[str, ...]:
        """Names of the further layers."""
        if self.layers is None:
            return ()
        from ambinav.ambiguity.layers.registry import chosen_layers

        names = [name.strip() for name in self.layers.split(",")]
        return tuple(layer.name for layer in chosen_layers(names, scanner))


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """Which floor counts: what the robot reaches."""

    PANEL: ClassVar[str] = "Robot"

    robot_radius: Annotated[
        float | None,
        typer.Option(
            "--robot-radius",
            metavar="M",
            help="Of the disc that covers the robot, metres; floor that it cannot reach does not "
            "count.",
            show_default="the scanner's robot_radius, or 0.2",
        ),
    ] = None
    start: Annotated[
        tuple[float, float] | None,
        typer.Option(
            "--start",
            metavar="X Y",
            help="Where the robot starts, map frame, metres.",
            show_default="the largest piece of floor",
        ),
    ] = None
