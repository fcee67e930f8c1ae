"""Three-dimensional building from a file: a plan with a height, an .ifc file or a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import InstanceOf

from ambinav.buildings.load import load_environment
from ambinav.buildings.readers import MAP_READERS
from ambinav.casting.mesh.mesh import Mesh
from ambinav.config import ConfigModel, Count, Number, Positive, Switch, check_fields, of_mapping
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.runtime.errors import InputError
from ambinav.sensing.robot_radius import robot_radius as own_radius
from ambinav.sensing.scanner import RangeScanner

OCTOMAPS: Final = (".bt", ".ot")
"""Suffixes of OctoMaps: occupied or free, and with all that a tree holds."""
PROCESSES: Final = 2
"""Embree holds the interpreter's lock."""
OF_A_MESH: Final = ("robot_height", "floor", "up")
OF_A_CLOUD: Final = ("voxel", "voxel_points")


@dataclass(frozen=True, kw_only=True)
class SpaceSettings:
    """Settings that make a building three-dimensional.

    Attributes:
        extrude: Height of the walls of a plan, metres, between a floor and a ceiling.
        in_space: Take an .ifc building with its heights.
        robot_height: Height of the robot in a mesh, metres; None: of its highest sensor.
        floor: z of the floor of a mesh, metres; None: its largest level surface.
        up: Which axis of a mesh or a point cloud is up; None: z, of a .glb y.
        voxel: Edge of the voxels that are made of a point cloud, metres; None: 0.05.
        voxel_points: Leave out voxels with fewer points; None: 1.

    Raises:
        InputError: a value is of no use, or two exclude each other.
    """

    extrude: Positive | None = None
    in_space: Switch = False
    robot_height: Positive | None = None
    floor: Number | None = None
    up: Literal["x", "y", "z"] | None = None
    voxel: Positive | None = None
    voxel_points: Count | None = None

    def __post_init__(self) -> None:
        """Check every field and convert it to its type."""
        check_fields(self)
        if self.in_space and self.extrude is not None:
            raise InputError(
                "extrude: with in_space the building has the heights of its file; leave one of "
                "the two out."
            )

    def load(
        self, path: Path, scanner: RangeScanner | None, robot_radius: float = 0.0, **reading: Any
    ) -> Environment:
        """Read a building.

        Args:
            path: Its file.
            scanner: At its height; None: not known yet, and a mesh is refused.
            robot_radius: Radius of a robot on the floor of a mesh, metres; 0: the scanner's, or
                0.2.
            reading: How the file is read otherwise, as in `load_environment`.

        Raises:
            InputError: the file cannot be used, or a setting does not suit it.
        """
        if (cloud := _triangles_of(path)) is not None:
            return self._floor(path, cloud, scanner, robot_radius, reading)
        environment = load_environment(path, in_space=self.in_space or None, **reading)
        self._refuse(OF_A_CLOUD, f"{path} is not a point cloud; leave it out.")
        other = ", or give extrude for a plan's height" if self.extrude is None else ""
        self._refuse(OF_A_MESH, f"{path} is not a mesh; leave it out{other}.")
        if self.extrude is None:
            return environment
        return environment.in_space(extruded(environment, self.extrude))

    def _floor(
        self,
        path: Path,
        cloud: bool,
        scanner: RangeScanner | None,
        robot_radius: float,
        reading: dict[str, Any],
    ) -> Environment:
        """Read the floor of a mesh or a point cloud, with its triangles."""
        if self.extrude is not None or self.in_space:
            raise InputError(
                f"{'in_space' if self.in_space else 'extrude'}: {path} has three dimensions "
                "already; leave it out."
            )
        for name, value in reading.items():
            if value is not None and name != "unit":
                raise InputError(f"{path}: {name} means nothing for triangles; leave it out.")
        if scanner is None:
            raise InputError(
                f"{path}: its floor is found for a robot with a scanner, which is not known here; "
                "give a plan, or in Python map={'file': ...} of the environments."
            )
        if not cloud:
            self._refuse(OF_A_CLOUD, f"{path} is not a point cloud; leave it out.")
        if path.suffix.lower() in OCTOMAPS:
            self._refuse(("up",), f"{path} is an OctoMap, whose z is up; leave it out.")
        from ambinav.buildings.mesh.floor import floor_environment

        if not path.is_file():
            raise InputError(f"{path}: there is no such file; give the path of a building.")
        height = self.robot_height
        if height is None:
            height = float(scanner.upright[:, 0].max())
            if not height > 0.0:
                raise InputError(
                    f"{path}: it has three dimensions, and scanner {scanner.name!r} does not "
                    "say how high it is mounted; give --scanner-height, e.g. 0.3."
                )
        mesh = self._triangles(path, cloud, reading.get("unit"))
        radius = robot_radius or own_radius(scanner)
        return floor_environment(mesh, height, radius, floor=self.floor)

    def _triangles(self, path: Path, cloud: bool, unit: str | None) -> Mesh:
        """Read a mesh, or mesh the voxels of an OctoMap or a point cloud."""
        from ambinav.buildings.mesh.cloud import VOXEL, read_cloud
        from ambinav.buildings.mesh.octomap import read_octomap
        from ambinav.buildings.mesh.read import read_mesh

        if path.suffix.lower() in OCTOMAPS:
            return read_octomap(path, unit=unit, processes=PROCESSES)
        if not cloud:
            return read_mesh(path, unit=unit, up=self.up, processes=PROCESSES)
        return read_cloud(
            path, voxel=self.voxel or VOXEL, points=self.voxel_points or 1, unit=unit, up=self.up,
            processes=PROCESSES,
        )  # fmt: skip

    def _refuse(self, names: Sequence[str], why: str) -> None:
        """Raise `InputError` if any of these settings was given."""
        for name in names:
            if getattr(self, name) is not None:
                raise InputError(f"{name}: {why}")


def _triangles_of(path: Path) -> bool | None:
    """Return whether a file holds points, not a mesh or an OctoMap; None: it holds neither."""
    from ambinav.buildings.mesh.cloud import is_cloud
    from ambinav.buildings.mesh.read import SUFFIXES

    suffix = path.suffix.lower()
    # What a plug-in reads is its own, of whatever suffix.
    if suffix.removeprefix(".") in MAP_READERS.names():
        return None
    if is_cloud(path):
        return True
    return False if suffix in (*SUFFIXES, *OCTOMAPS) else None


class PlanPart(ConfigModel):
    """Options for reading a plan of a building; see `load_environment`."""

    height: float | None = None
    doors: str | None = None
    glass: str | None = None
    furniture: bool | None = None
    layers: dict[str, str] | None = None


class BuildingPart(ConfigModel):
    """Keys of a file that say how to read its building."""

    level: str | int | None = None
    unit: str | None = None
    plan: PlanPart = PlanPart()
    space: Annotated[InstanceOf[SpaceSettings], of_mapping(SpaceSettings)] = SpaceSettings()

    def load(self, path: Path, scanner: RangeScanner, robot_radius: float) -> Environment:
        """Read the building, see `SpaceSettings.load`.

        Raises:
            InputError: the file cannot be used, or a key does not suit it.
        """
        reading = {"level": self.level, "unit": self.unit, **self.plan.model_dump()}
        return self.space.load(path, scanner, robot_radius, **reading)
