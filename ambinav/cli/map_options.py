"""Option groups on a building, on its map, and on the floor that counts."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.beacon_options import LAYER as BEACONS
from ambinav.cli.checks import naming_options, option_name
from ambinav.cli.limits import above_zero, at_least, not_negative
from ambinav.cli.running import note
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress

if TYPE_CHECKING:
    from ambinav.cli.space_options import HeightOptions, SpaceOptions
    from ambinav.geometry.collision.reach import Reach
    from ambinav.geometry.environment import Environment
    from ambinav.map_building.build import MapSettings
    from ambinav.map_building.estimate import Estimate
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.sensing.scanner import RangeScanner

LONG_SECONDS = 60.0
"""A map that takes longer is announced."""
FEW_BEAMS, FINE = 12, 4
"""With so few beams, cells have to be finer than this part of the neighbourhood's radius."""
LARGE_BYTES = 4e9
"""A map that takes more memory is announced."""


Spacing = Annotated[
    float,
    above_zero("0.1"),
    typer.Option("--spacing", metavar="M", help="Distance between map cells, metres."),
]
AmbiguityRadius = Annotated[
    float,
    above_zero("0.5"),
    typer.Option(
        "--ambiguity-radius",
        metavar="M",
        help="Radius around a pose within which scans are compared, metres.",
    ),
]
MapStd = Annotated[
    float | None,
    not_negative("0.05"),
    typer.Option(
        "--map-std",
        metavar="M",
        help="Standard deviation of wall positions in the map, metres.",
        show_default="0.03 for occupancy maps, 0.02 for drawings",
    ),
]
RobotRadius = Annotated[
    float | None,
    above_zero("0.2"),
    typer.Option(
        "--robot-radius",
        metavar="M",
        help="Radius of the disc that covers the robot, metres; floor that it cannot reach is not "
        "counted.",
        show_default="the scanner's robot_radius, or 0.2",
    ),
]


@dataclass(frozen=True, kw_only=True)
class BuildingOptions:
    """Options on reading the file of a building.

    Attributes:
        level (NAME|INDEX): The floor of a plan with several: its name, or its position from 0 on.
            [default: the only one]
        unit (m|cm|mm|in|ft): Unit of a drawn plan's coordinates. [default: metres, or the unit in a
            .dxf if it gives a plausible building]
        height (M): Height above the floor at which an .ifc building is cut: the scanner's.
            [default: 0.3]
        doors (open|closed): Doors of an .ifc or .dxf plan. [default: open]
        glass (solid|clear): Panes of an .ifc or .dxf plan: clear ones stop robots, not rays.
            [default: solid]
        no_furniture: Leave out the furniture of an .ifc or .dxf plan.
        cad_layer (NAME=ROLE): Content of a layer of a .dxf plan: walls, columns, glass, doors,
            furniture, floor or ignore; repeatable. [default: by its name]
    """

    PANEL: ClassVar[str] = "Building"

    level: str | None = None
    unit: str | None = None
    height: float | None = None
    doors: str | None = None
    glass: str | None = None
    no_furniture: bool = False
    cad_layer: list[str] | None = None

    def load(self, map_file: Path) -> Environment:
        """Load a building as a plan.

        Raises:
            InputError: it cannot be used.
        """
        from ambinav.buildings.load import load_environment

        return load_environment(map_file, **self.reading())

    def reading(self) -> dict[str, Any]:
        """Return the keyword arguments of `load_environment`.

        Raises:
            InputError: a --cad-layer is no pair.
        """
        layers = {}
        for pair in self.cad_layer or ():
            name, equals, role = pair.rpartition("=")
            if not (name and equals):
                raise InputError(f"--cad-layer: {pair!r} is not NAME=ROLE; give e.g. 0=walls.")
            layers[name] = role
        return {
            "level": self.level,
            "unit": self.unit,
            "height": self.height,
            "doors": self.doors,
            "glass": self.glass,
            "furniture": False if self.no_furniture else None,
            "layers": layers or None,
        }


def check_with_map(map_file: object, *groups: BuildingOptions | HeightOptions) -> None:
    """Refuse options on a building if a map is given instead.

    Raises:
        InputError: they come without.
    """
    for group in groups:
        for field in fields(group):
            value = getattr(group, field.name)
            if value != field.default and not map_file:
                raise InputError(
                    f"{option_name(field.name)}: {value!r} describes a plan; give it together with "
                    "--map."
                )


def check_radius(radius: float, spacing: float) -> None:
    """Check that a neighbourhood has more than its centre, metres.

    Raises:
        InputError: its radius is less than the spacing.
    """
    if radius < spacing:
        raise InputError(
            f"--ambiguity-radius: {radius:g} m is less than the spacing of {spacing:g} m; give at "
            "least one spacing."
        )


@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """Options on the layers and the resolution of the map.

    Attributes:
        headings (N): Number of headings in the map. [default: as the scanner requires]
        layers (NAMES): Further layers, e.g. fisher,gfm; all: those that suit the scanner, except
            slow ones. [default: none]
    """

    PANEL: ClassVar[str] = "Map"

    spacing: Spacing = 0.1
    radius: AmbiguityRadius = 0.5
    headings: Annotated[int | None, at_least(1)] = None
    map_std: MapStd = None
    layers: str | None = None
    no_store: options.NoStore = False

    def load(
        self,
        map_file: Path,
        scanner: str | RangeScanner,
        building: BuildingOptions,
        space: SpaceOptions | None = None,
        robot_radius: float = 0.0,
    ) -> tuple[Environment, RangeScanner]:
        """Load the scanner, then the building; errors of the scanner are found sooner.

        Args:
            map_file: The building.
            scanner: A preset or a file; or a scanner, mounted already.
            building: Options on reading the building.
            space: Options that make it three-dimensional, if the command has them.
            robot_radius: Radius of a robot on the floor of a mesh, metres; 0: not given.

        Raises:
            InputError: one cannot be used, the spacing exceeds the building, or there is no layer
                of a name or not for the scanner.
        """
        from ambinav.sensing.presets import preset_names
        from ambinav.sensing.scanner import RangeScanner

        if isinstance(scanner, RangeScanner):
            chosen = scanner
        else:
            chosen = RangeScanner.load(scanner)
            if space is not None:
                chosen = space.mounted(chosen)
        self._layer_names(chosen)
        if str(map_file) in preset_names():
            raise InputError(
                f"{map_file}: this is a scanner preset, not a building; give it with --scanner."
            )
        if space is None:
            environment = building.load(map_file)
        else:
            environment = space.load(map_file, chosen, robot_radius, **building.reading())
            if space.scanner_height is not None and environment.space is None:
                raise InputError(
                    f"--scanner-height: {map_file} is a plan, in which no height counts; leave it "
                    "out, give --extrude or --in-space with it, or --height for the cut of an .ifc "
                    "file."
                )
        xmin, ymin, xmax, ymax = environment.bounds
        if self.spacing > max(xmax - xmin, ymax - ymin):
            raise InputError(
                f"--spacing: {self.spacing:g} m is larger than the building in {map_file} "
                f"({xmax - xmin:.3g} x {ymax - ymin:.3g} m); give less, e.g. 0.1."
            )
        return environment, chosen

    def estimate(self, environment: Environment, scanner: RangeScanner) -> Estimate:
        """Estimate what the map of a scanner takes."""
        from ambinav.map_building.estimate import estimate

        return estimate(environment, scanner, self.spacing, self.radius, self.headings)

    def announce(self, environment: Environment, scanner: RangeScanner, heights: int = 1) -> None:
        """Print time and memory on stderr before a map that takes long is built.

        And what a wider spacing would make of it. Of a volume, time and poses are of all heights.
        """
        from ambinav.map_building.estimate import coarser

        spacing, radius = self.spacing, self.radius
        if not 0.0 < spacing <= radius:
            return  # which `build_map` refuses
        if scanner.beams <= FEW_BEAMS and spacing > radius / FINE:
            note(
                f"with {scanner.beams} beams a spacing of {spacing:g} m and an ambiguity radius of "
                f"{radius:g} m the levels come out too low and depend on the orientation of the "
                f"building; give --spacing {radius / FINE:g} or less."
            )
        needs = self.estimate(environment, scanner).times(heights)
        if needs.seconds < LONG_SECONDS and needs.bytes < LARGE_BYTES:
            return
        max_seconds = LONG_SECONDS / heights
        wider = coarser(environment, scanner, spacing, radius, self.headings, max_seconds)
        remedy = (
            "" if wider is None else f"; with --spacing {wider.spacing:g} {wider.times(heights)}"
        )
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
        *,
        quiet: bool = False,
    ) -> AmbiguityMap:
        """Open the map from the store; otherwise announce, build and store it.

        With `quiet` nothing is said of what is opened, as of the many maps of a search.

        Raises:
            InputError: an option does not suit this building, or see `MapStore.of_user`.
        """
        from ambinav.map_building.build import build_map

        store = options.store_of(self.no_store, lambda: self.announce(environment, scanner))
        return build_map(
            environment,
            scanner,
            spacing=self.spacing,
            progress=progress,
            robot_radius=robot_radius,
            **self.arguments(scanner),
            store=replace(store, notify=None) if quiet else store,
        )

    def settings(
        self, environment: Environment, scanner: RangeScanner, robot_radius: float = 0.0
    ) -> MapSettings:
        """Return the settings of a map that is built in tiles.

        Raises:
            InputError: an option does not suit this building.
        """
        from ambinav.map_building.build import MapSettings

        return MapSettings.of(
            environment,
            scanner,
            spacing=self.spacing,
            robot_radius=robot_radius,
            **self.arguments(scanner),
        )

    def arguments(self, scanner: RangeScanner) -> dict[str, Any]:
        """Return the arguments that maps, tiled maps and volumes have in common."""
        return {
            "radius": self.radius,
            "headings": self.headings,
            "map_std": self.map_std,
            "layers": self._layer_names(scanner),
        }

    @property
    def named_layers(self) -> tuple[str, ...]:
        """Names of additional layers as they were given, such as "all"."""
        names = [] if self.layers is None else self.layers.split(",")
        return tuple(name.strip() for name in names)

    def _layer_names(self, scanner: RangeScanner) -> tuple[str, ...]:
        """Return the names of additional layers; the meaning of "all" depends on the building."""
        if self.layers is None:
            return ()
        from ambinav.layers.registry import chosen_layers

        names = self.named_layers
        if BEACONS in names:
            raise InputError(
                f"--layers: {BEACONS} needs the places of beacons; leave it out, and give "
                "--beacons FILE, which adds it."
            )
        chosen_layers(names, scanner)
        return names


@dataclass(frozen=True, kw_only=True)
class ReachOptions:
    """Options on the floor that counts: reached by the robot.

    Attributes:
        start (X Y): Start of the robot, map frame, metres. [default: the largest piece of floor]
    """

    PANEL: ClassVar[str] = "Robot"

    robot_radius: RobotRadius = None
    start: tuple[float, float] | None = None

    def reach(self, environment: Environment, scanner: RangeScanner) -> Reach:
        """Find the floor that the robot reaches; of a radius not given, that of the scanner.

        Raises:
            InputError: see `find_reach`.
        """
        from ambinav.geometry.collision.reach import find_reach
        from ambinav.sensing.robot_radius import robot_radius

        radius = self.robot_radius or robot_radius(scanner)
        with naming_options(**{"from": "--start: from"}):
            return find_reach(environment, radius, self.start)
