"""Inputs of a tile of a map, and the function that makes it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import xarray as xr

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.dataset import clearance_layer, pose_layers, with_building
from ambinav.ambiguity.feasible_poses import standing
from ambinav.ambiguity.neighbourhoods import disc
from ambinav.ambiguity.returns import BEYOND
from ambinav.casting.prisms.part import PrismPart
from ambinav.casting.space import SpaceCaster
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.part import EnvironmentPart
from ambinav.layers.build import with_layers
from ambinav.map_building.build import MapSettings
from ambinav.map_building.selection import ChosenPoses
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.schema import BACKDROP
from ambinav.runtime.array_types import Bytes, Floats
from ambinav.runtime.progress import silent

# A part reaches this much farther than what is asked in it, metres.
SLACK = 0.1


@dataclass(frozen=True)
class Tile:
    """Window of a map's lattice.

    Attributes:
        rows: First row, and one past the last.
        columns: Likewise.
    """

    rows: tuple[int, int]
    columns: tuple[int, int]

    @property
    def window(self) -> tuple[slice, slice]:
        """Rows and columns as slices."""
        return slice(*self.rows), slice(*self.columns)

    @property
    def shape(self) -> tuple[int, int]:
        """Numbers of rows and columns."""
        return self.rows[1] - self.rows[0], self.columns[1] - self.columns[0]


@dataclass(frozen=True, eq=False)
class TileJob:
    """Settings that all tiles of a map share.

    Attributes:
        settings: What the map is made with.
        origin: Row and column of the lattice's first point, in spacings from the map's origin.
        shape: Rows and columns of the lattice.
        reflectors: Whether there is a reflector anywhere in the building.
        floor: z of the floor of a building in space, metres.
        space: Scene of a building in space, where it is not cut; see `TileInput.space`.
    """

    settings: MapSettings
    origin: tuple[int, int]
    shape: tuple[int, int]
    reflectors: bool
    floor: float = 0.0
    space: SpaceCaster | None = None

    @property
    def reach(self) -> int:
        """Rows and columns around a tile with which its poses are compared."""
        return int(disc(self.settings.model.radius, self.settings.spacing).max())

    @property
    def sight(self) -> float:
        """Distance from a tile's poses within which the building affects its values, metres."""
        settings = self.settings
        mounts = max(
            float(np.hypot(*scanner.mounts[:, :2].T).max())
            for scanner in (settings.mounted, settings.thinned)
        )
        seen = mounts + settings.thinned.max_range + BEYOND
        return max(self.reach * settings.spacing + seen + SLACK, self.touch)

    @property
    def touch(self) -> float:
        """Distance from a tile's poses within which walls affect where a body can stand, metres."""
        settings = self.settings
        return self.reach * settings.spacing + settings.model.robot_radius + SLACK

    def axes(self, rows: tuple[int, int], columns: tuple[int, int]) -> tuple[Floats, Floats]:
        """Return coordinates of columns and rows, metres, equal to `Lattice.axes` bit for bit."""
        spacing = self.settings.spacing
        x = (np.arange(columns[0], columns[1]) + self.origin[1] + 0.5) * spacing
        y = (np.arange(rows[0], rows[1]) + self.origin[0] + 0.5) * spacing
        return np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)

    @cached_property
    def poses(self) -> ChosenPoses:
        """Settings with which poses are computed."""
        settings = self.settings
        table = BeamTable.of(
            settings.thinned, settings.model.map_std, settings.model.outlier_share, self.reflectors
        )
        turning = settings.theta is None and settings.thinned.turns_in_place
        return ChosenPoses(settings.thinned, table, settings.model, settings.headings, turning)


@dataclass(frozen=True, eq=False)
class TileInput:
    """Tile, and the part of the building that affects it.

    Attributes:
        tile: The tile.
        part: The building up to `TileJob.sight` around it; None: no floor is in it.
        space: What rays meet there, of a building of prisms.
        solid: Mask of its cells that are solid, as bits (`numpy.packbits`).
        drawn: Whether those of them that are free are not solid (`Backdrop.solid`).
    """

    tile: Tile
    part: EnvironmentPart | None
    space: PrismPart | None
    solid: Bytes
    drawn: bool

    @property
    def nbytes(self) -> int:
        """Approximate number of bytes to send."""
        parts = (part for part in (self.part, self.space) if part is not None)
        return self.solid.nbytes + sum(part.nbytes for part in parts)


def tile_variables(job: TileJob, tile_input: TileInput) -> dict[str, xr.DataArray]:
    """Compute the layers of a tile, equal to those of `build_map` bit for bit.

    It depends on its arguments alone, not on what other tiles there are.

    Args:
        job: What all tiles have in common.
        tile_input: The tile, and the building around it.

    Returns:
        Variables over (y, x) or (y, x, theta), by name. Where a robot can stand nowhere in the
        tile, what is solid alone: the others hold nothing.
    """
    tile, part, settings = tile_input.tile, tile_input.part, job.settings
    count = math.prod(tile.shape)
    solid = np.unpackbits(tile_input.solid, count=count).reshape(tile.shape).astype(np.bool_)
    backdrop = {BACKDROP: xr.DataArray(solid, dims=("y", "x"))}
    if part is None:
        return backdrop
    space = tile_input.space or job.space
    env = part if space is None else part.in_space(space, job.floor)
    (low, high), (left, right), reach = tile.rows, tile.columns, job.reach
    rows = max(low - reach, 0), min(high + reach, job.shape[0])
    columns = max(left - reach, 0), min(right + reach, job.shape[1])
    x, y = job.axes(rows, columns)
    xs, ys = np.meshgrid(x, y)
    inside = part.triangulation.contains(xs.ravel(), ys.ravel()).reshape(xs.shape)
    inner = (slice(low - rows[0], high - rows[0]), slice(left - columns[0], right - columns[0]))
    if not inside[inner].any():
        return backdrop
    around = Lattice(env, settings.spacing, x, y, inside)
    possible = standing(around, settings.mounted, settings.headings, settings.model.robot_radius)
    somewhere = np.asarray(possible.any(axis=1))
    around, possible = around.among(somewhere), possible[somewhere]
    free = np.ascontiguousarray(around.free[inner])
    if not free.any():
        return backdrop
    chosen = np.zeros_like(around.free)
    chosen[inner] = free
    results = job.poses.sums(around, possible, chosen[around.free], silent)
    lattice = Lattice(env, settings.spacing, *job.axes(tile.rows, tile.columns)[:2], free)
    variables = pose_layers(lattice, settings.model, settings.theta, results)
    variables["clearance"] = clearance_layer(lattice)
    if tile_input.drawn:
        solid &= ~free
    dataset = with_building(
        variables, lattice, settings.scanner, settings.thinned, settings.model, settings.theta,
        solid,
    )  # fmt: skip
    if settings.layers:
        amap = with_layers(AmbiguityMap(dataset), settings.layers, environment=env)
        dataset = amap.dataset
    return {str(name): array for name, array in dataset.items() if array.dims[:2] == ("y", "x")}
