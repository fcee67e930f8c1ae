"""Options on a building in three dimensions: a plan with a height, an .ifc file, a mesh."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from ambinav.cli.checks import naming_options
from ambinav.cli.limits import above_zero, at_least

if TYPE_CHECKING:
    from ambinav.geometry.environment import Environment
    from ambinav.sensing.building_file import SpaceSettings
    from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True, kw_only=True)
class HeightOptions:
    """Options that make the building of a plan or of an .ifc file three-dimensional.

    Attributes:
        extrude (M): Height of a plan's walls, metres; adds a floor and a ceiling. [default: a plan]
        in_space: Use the heights of an .ifc building: slabs, lintels, parapets, furniture.
    """

    PANEL: ClassVar[str] = "Space"

    extrude: Annotated[float | None, above_zero("2.5")] = None
    in_space: bool = False

    def check(self) -> None:
        """Check what can be checked before the building is read.

        Raises:
            InputError: an option has a value that cannot be used.
        """
        with naming_options(*(field.name for field in fields(self))):
            self.settings()

    def settings(self) -> SpaceSettings:
        """Return the settings without the scanner's height.

        Raises:
            InputError: a value is of no use.
        """
        from ambinav.sensing.building_file import SpaceSettings

        values = {field.name: getattr(self, field.name) for field in fields(self)}
        values.pop("scanner_height", None)
        return SpaceSettings(**values)

    def load(
        self, path: Path, scanner: RangeScanner | None, robot_radius: float = 0.0, **reading: Any
    ) -> Environment:
        """Read a building, see `SpaceSettings.load`.

        Raises:
            InputError: it cannot be used, or an option does not suit it.
        """
        with naming_options(*(field.name for field in fields(self))):
            return self.settings().load(path, scanner, robot_radius, **reading)


@dataclass(frozen=True, kw_only=True)
class SpaceOptions(HeightOptions):
    """Options that make a building three-dimensional and set the scanner's height.

    Attributes:
        scanner_height (M): Raise the scanner by this height above that of its file, metres.
            [default: the height of the file]
        robot_height (M): Height of the robot, for a mesh: anything lower is an obstacle. [default:
            height of its highest sensor]
        floor (Z): z of the floor of a mesh, metres. [default: the largest level surface]
        up (x|y|z): Upward axis of a mesh or a point cloud. [default: z; for a .glb y]
        voxel (M): Edge length of the voxels of a point cloud, metres. [default: 0.05]
        voxel_points (N): Leave out voxels with fewer points, as outliers. [default: 1]
    """

    scanner_height: Annotated[float | None, above_zero("0.3")] = None
    robot_height: Annotated[float | None, above_zero("1.2")] = None
    floor: float | None = None
    up: str | None = None
    voxel: Annotated[float | None, above_zero("0.05")] = None
    voxel_points: Annotated[int | None, at_least(1)] = None

    def mounted(self, scanner: RangeScanner) -> RangeScanner:
        """Return the scanner at its height."""
        return scanner if self.scanner_height is None else scanner.raised(self.scanner_height)
