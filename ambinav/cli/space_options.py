"""Options on a building in three dimensions: a plan with a height, an .ifc file, mesh or scan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar, Final

import typer

from ambinav.cli.running import above_zero
from ambinav.errors import InputError

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.geometry.mesh.mesh import Mesh
    from ambinav.sensing.scanner import RangeScanner

OCTOMAP: Final = ".bt"
PROCESSES: Final = 2
"""Embree holds the interpreter's lock."""


@dataclass(frozen=True, kw_only=True)
class SpaceOptions:
    """What makes a building three-dimensional, and how high the scanner is in it."""

    PANEL: ClassVar[str] = "Space"

    extrude: Annotated[
        float | None,
        typer.Option(
            "--extrude",
            metavar="M",
            help="Take the walls of a plan for so many metres high, with a floor and a ceiling.",
            show_default="a plan",
        ),
    ] = None
    in_space: Annotated[
        bool,
        typer.Option(
            "--in-space",
            help="Take an .ifc building with its heights: slabs, lintels, parapets, furniture.",
        ),
    ] = False
    scanner_height: Annotated[
        float | None,
        typer.Option(
            "--scanner-height",
            metavar="M",
            help="Mount the scanner so many metres higher than its file says.",
            show_default="as the file says",
        ),
    ] = None
    robot_height: Annotated[
        float | None,
        typer.Option(
            "--robot-height",
            metavar="M",
            help="Of the robot, in a mesh: what is lower than that stands in its way.",
            show_default="of its highest sensor",
        ),
    ] = None
    floor: Annotated[
        float | None,
        typer.Option(
            "--floor",
            metavar="Z",
            help="z of the floor of a mesh, metres.",
            show_default="the largest level surface",
        ),
    ] = None
    up: Annotated[
        str | None,
        typer.Option(
            "--up",
            metavar="x|y|z",
            help="Which axis of a mesh or a point cloud is up.",
            show_default="z, of a .glb y",
        ),
    ] = None
    voxel: Annotated[
        float | None,
        typer.Option(
            "--voxel",
            metavar="M",
            help="Edge of the voxels that are made of a point cloud.",
            show_default="0.05",
        ),
    ] = None
    voxel_points: Annotated[
        int | None,
        typer.Option(
            "--voxel-points",
            metavar="N",
            help="Leave out voxels of a point cloud with fewer points: stray ones.",
            show_default="1",
        ),
    ] = None

    def check(self) -> None:
        """Check what can be checked before the building is read.

        Raises:
            InputError: an option has a value that cannot be used.
        """
        above_zero(self.extrude, "--extrude", "2.5")
        above_zero(self.scanner_height, "--scanner-height", "0.3")
        above_zero(self.robot_height, "--robot-height", "1.2")
        above_zero(self.voxel, "--voxel", "0.05")
        above_zero(self.voxel_points, "--voxel-points", "2")
        if self.in_space and self.extrude is not None:
            raise InputError(
                "--extrude: with --in-space the building has the heights of its file; leave one of "
                "the two out."
            )

    def mounted(self, scanner: RangeScanner) -> RangeScanner:
        """The scanner at its height."""
        return scanner if self.scanner_height is None else scanner.raised(self.scanner_height)

    def mesh(
        self, map_file: Path, scanner: RangeScanner, unit: str | None, robot_radius: float
    ) -> Environment | None:
        """The floor of a mesh, with the mesh; None where the file is no mesh and no point cloud.

        Args:
            map_file: The file.
            scanner: At its height.
            unit: What its numbers are in, as `read_mesh` takes it.
            robot_radius: Metres; 0: the scanner's, or 0.2 where it has none.

        Raises:
            InputError: it cannot be used, or an option does not suit it.
        """
        from ambinav.geometry.io.readers import READERS
        from ambinav.geometry.mesh.cloud import is_cloud
        from ambinav.geometry.mesh.read import SUFFIXES

        suffix = map_file.suffix.lower()
        # What a plug-in reads is its own, of whatever suffix.
        if suffix.removeprefix(".") in READERS.names():
            return None
        if not (cloud := is_cloud(map_file)) and suffix not in (*SUFFIXES, OCTOMAP):
            return None
        if self.extrude is not None or self.in_space:
            raise InputError(
                f"--{'in-space' if self.in_space else 'extrude'}: {map_file} has three dimensions "
                "already; leave the option out."
            )
        if not cloud:
            self._refuse(("voxel", "voxel_points"), f"{map_file} is no point cloud")
        from ambinav.geometry.mesh.floor import floor_environment
        from ambinav.sensing.robot_radius import robot_radius as own

        height = self.robot_height
        if height is None:
            height = float(scanner.upright[:, 0].max())
            if not height > 0.0:
                raise InputError(
                    f"{map_file}: it has three dimensions, and scanner {scanner.name!r} does not "
                    "say how high it is mounted; give --scanner-height, e.g. 0.3."
                )
        found = self._read(map_file, cloud, unit)
        return floor_environment(found, height, robot_radius or own(scanner), floor=self.floor)

    def _read(self, map_file: Path, cloud: bool, unit: str | None) -> Mesh:
        """The triangles of a mesh, or those around the voxels of an OctoMap or a point cloud."""
        from ambinav.geometry.mesh.cloud import VOXEL, read_cloud
        from ambinav.geometry.mesh.octomap import read_octomap
        from ambinav.geometry.mesh.read import read_mesh

        if map_file.suffix.lower() == OCTOMAP:
            return read_octomap(map_file, processes=PROCESSES)
        if not cloud:
            return read_mesh(map_file, unit=unit, up=self.up, processes=PROCESSES)
        return read_cloud(
            map_file, voxel=self.voxel or VOXEL, points=self.voxel_points or 1, unit=unit,
            up=self.up, processes=PROCESSES,
        )  # fmt: skip

    def _refuse(self, names: Sequence[str], why: str) -> None:
        """Refuse options that were given; raises `InputError`."""
        for field in fields(self):
            if field.name in names and getattr(self, field.name) is not None:
                raise InputError(f"--{field.name.replace('_', '-')}: {why}; leave the option out.")

    def extruded(self, environment: Environment) -> Environment:
        """A plan with the height that was given, if one was.

        Raises:
            InputError: an option for meshes alone was given.
        """
        where = environment.source or environment.name
        self._refuse(("voxel", "voxel_points"), f"{where} is no point cloud")
        names = ("robot_height", "floor", "up")
        self._refuse(names, f"{where} is no mesh (for a plan's height there is --extrude)")
        if self.extrude is None:
            return environment
        from ambinav.geometry.extrude import extruded

        return environment.in_space(extruded(environment, self.extrude))
