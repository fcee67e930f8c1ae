"""Plan of a map in tiles: the tiles, their inputs, and their expected cost."""

from __future__ import annotations

import copy
import itertools
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numba
import numpy as np
import shapely
import xarray as xr

from ambinav.casting.mesh.mesh import Mesh
from ambinav.casting.prisms.part import part_of
from ambinav.casting.prisms.prisms import Prisms
from ambinav.casting.space import SpaceCaster
from ambinav.config import as_number
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.outside import Backdrop
from ambinav.geometry.part import PartCutter
from ambinav.map_building.build import MapSettings
from ambinav.map_building.stored import map_key
from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of
from ambinav.tiles.job import SLACK, Tile, TileInput, TileJob, tile_variables

MOST_CELLS: Final = 10**11
"""Maximum number of cells of a lattice that is cut into tiles."""
MOST_TILE_CELLS: Final = 50_000_000
"""Maximum number of cells of a tile: a process holds all of its layers at once."""
SAMPLE: Final = 48
"""Rows and columns of the sample that is timed."""
SAMPLES: Final = 40
"""Places at which one is looked for."""
PROGRAM: Final = 350e6
"""Bytes of a process with all libraries."""
PER_CELL: Final = 320.0
"""Bytes of a tile's cell and heading: sums, layers and what they are made of."""


@dataclass(frozen=True)
class TileEstimate:
    """Expected cost of a map in tiles.

    Attributes:
        poses: Free points, about.
        tiles: All of them, those without floor included.
        headings: At each pose.
        seconds: On the workers, together.
        stored: Bytes on disk, at most about.
        sent: Bytes of the building that are sent to the workers with all tiles, about.
        memory: Bytes that a worker takes at its peak, about.
    """

    poses: int
    tiles: int
    headings: int
    seconds: float
    stored: int
    sent: int
    memory: int


@dataclass(frozen=True, eq=False)
class TilePlan:
    """Map divided into tiles.

    Attributes:
        environment: The building.
        job: What all tiles have in common.
        cells: Rows and columns of a tile; the last ones may be smaller.
    """

    environment: Environment
    job: TileJob
    cells: int

    @classmethod
    def of(cls, environment: Environment, settings: MapSettings, tile: float) -> TilePlan:
        """Divide the map of a building into tiles.

        Args:
            environment: The building.
            settings: What the map is made with.
            tile: Edge of a tile, metres; rounded to whole spacings.

        Raises:
            InputError: the edge is less than a spacing or makes a tile that no memory holds, or a
                layer is asked for that is made of the whole map.
        """
        spacing, tile = settings.spacing, as_number(tile, "tile")
        if not (math.isfinite(tile) and tile >= spacing):
            raise InputError(
                f"tile is {tile:g} m and spacing {spacing:g} m; give an edge of at least one "
                "spacing, e.g. 20."
            )
        cells = round(tile / spacing)
        if cells**2 * len(settings.headings) > MOST_TILE_CELLS:
            raise InputError(
                f"tile is {tile:g} m, {cells} x {cells} poses of {spacing:g} m with "
                f"{len(settings.headings)} headings, which no process holds at once; give a "
                "smaller one, e.g. 20."
            )
        full = [name for name in settings.layers if name != "position"]
        if full:
            raise InputError(
                f"layers: {', '.join(full)} cannot be made tile by tile; leave them out, or make "
                "the map without tiles."
            )
        x, y = Lattice.axes(environment, spacing, MOST_CELLS)
        origin = round(float(y[0]) / spacing - 0.5), round(float(x[0]) / spacing - 0.5)
        job = TileJob(
            settings, origin, (len(y), len(x)), environment.has_reflectors, environment.floor,
            _uncut_scene(environment),
        )  # fmt: skip
        return cls(environment, job, cells)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of tiles."""
        rows, columns = (-(-count // self.cells) for count in self.job.shape)
        return rows, columns

    @cached_property
    def key(self) -> str:
        """Digest of everything that determines the map and its tiles.

        Raises:
            InputError: code from elsewhere takes part, so that nobody knows when it changes.
        """
        settings = self.job.settings
        key = map_key(
            self.environment, settings.scanner, settings.thinned, settings.model,
            settings.spacing, settings.theta, settings.layers,
        )  # fmt: skip
        if key is None:
            raise InputError(
                f"{settings.scanner.name}: classes from elsewhere take part in this map, and tiles "
                "that other processes make of them cannot be told apart; make it without tiles."
            )
        return digest_of(key, self.cells)[:32]

    def tile(self, row: int, column: int) -> Tile:
        """Return a tile by its row and column among the tiles."""
        spans = [
            (k * self.cells, min((k + 1) * self.cells, count))
            for k, count in zip((row, column), self.job.shape, strict=True)
        ]
        return Tile(spans[0], spans[1])

    def tiles(self) -> Iterator[Tile]:
        """Yield all tiles, row by row."""
        for row, column in np.ndindex(self.shape):
            yield self.tile(row, column)

    @cached_property
    def _cutter(self) -> PartCutter:
        return PartCutter.of(
            self.environment, footprints=self.job.settings.model.robot_radius > 0.0
        )

    @cached_property
    def _backdrop(self) -> Backdrop:
        return Backdrop.of(self.environment)

    def input(self, tile: Tile) -> TileInput:
        """Return a tile with the part of the building that affects it."""
        x, y = self.job.axes(tile.rows, tile.columns)
        solid = self._backdrop.over(x, y, self.job.settings.spacing)
        bits, drawn = np.packbits(solid), self.environment.occupancy is None
        if not self._cutter.meets((x[0], y[0], x[-1], y[-1])):
            return TileInput(tile, None, None, bits, drawn)
        # Upper bound of the distance to the nearest wall in the tile.
        middle = (x[0] + x[-1]) / 2, (y[0] + y[-1]) / 2
        half = math.hypot(x[-1] - x[0], y[-1] - y[0]) / 2
        clear = float(self.environment.clearance(*middle)) + half + SLACK
        around, beside = (
            (x[0] - margin, y[0] - margin, x[-1] + margin, y[-1] + margin)
            for margin in (max(self.job.sight, clear), self.job.touch)
        )
        space = self.environment.space
        cut = part_of(space, around) if isinstance(space, Prisms) else None
        return TileInput(tile, self._cutter.part(around, beside), cut, bits, drawn)

    @cached_property
    def sample(self) -> tuple[TileInput, dict[str, xr.DataArray]]:
        """Small tile that contains floor, somewhere in the building, and its variables.

        Raises:
            InputError: the robot can stand nowhere.
        """
        for tile in itertools.chain(self._samples(), self.tiles()):
            tile_input = self.input(tile)
            variables = tile_variables(self.job, tile_input)
            if "free" in variables:
                return tile_input, variables
        raise InputError(
            f"at no point of {self.environment.name} a robot with scanner "
            f"{self.job.settings.scanner.name!r} fits; check its mounts (metres), the robot's "
            "radius and the spacing."
        )

    def _samples(self) -> Iterator[Tile]:
        """Yield small tiles around some points."""
        rows, columns = self.job.shape
        spacing = self.job.settings.spacing
        for x, y in self._places():
            low = min(max(int(y / spacing) - self.job.origin[0] - SAMPLE // 2, 0), rows - 1)
            left = min(max(int(x / spacing) - self.job.origin[1] - SAMPLE // 2, 0), columns - 1)
            yield Tile((low, min(low + SAMPLE, rows)), (left, min(left + SAMPLE, columns)))

    def _places(self) -> Iterator[tuple[float, float]]:
        """Yield points of the floor: in its largest pieces, then in triangles anywhere."""
        floor = shapely.get_parts(self.environment.free)
        largest = floor[np.argsort(-shapely.area(floor))][: SAMPLES // 4]
        triangles = self.environment.triangulation.corner.reshape(-1, 3, 2)
        chosen = np.linspace(0, len(triangles) - 1, SAMPLES - len(largest)).astype(int)
        points = [
            shapely.get_coordinates(shapely.point_on_surface(largest)),
            triangles[chosen].mean(axis=1),
        ]
        yield from np.concatenate(points).tolist()

    def estimate(self, workers: int) -> TileEstimate:
        """Time a sample, and estimate the whole on this many workers."""
        tile_input, variables = self.sample  # made once before, so that kernels are compiled
        threads = numba.get_num_threads()
        numba.set_num_threads(1)
        try:
            start = time.perf_counter()
            tile_variables(self.job, tile_input)
            seconds = time.perf_counter() - start
        finally:
            numba.set_num_threads(threads)
        settings = self.job.settings
        headings = len(settings.headings)
        poses = self.environment.free.area / settings.spacing**2
        here = int(variables["free"].values.sum())
        each = sum(
            array.dtype.itemsize * (headings if "theta" in array.dims else 1)
            for array in variables.values()
        )
        tiles = math.prod(self.shape)
        sent = self.input(self._busy_tile(tile_input.tile)).nbytes
        beams = len(self.job.poses.table.limit)
        band = min((self.cells + 2 * self.job.reach) ** 2, 256_000_000 // (beams * 20 * headings))
        return TileEstimate(
            round(poses),
            tiles,
            headings,
            seconds * poses / max(here, 1) / max(workers, 1),
            round(poses * each),
            tiles * sent,
            round(PROGRAM + band * beams * 20 * headings + self.cells**2 * headings * PER_CELL),
        )

    def _busy_tile(self, near: Tile) -> Tile:
        """Return the tile in which another tile begins."""
        return self.tile(near.rows[0] // self.cells, near.columns[0] // self.cells)


def _uncut_scene(environment: Environment) -> SpaceCaster | None:
    """Return the rays' scene if each worker needs all of it: a mesh, sorted by Embree.

    Which of two that meet at an edge it names depends on all of them. Each worker casts by itself.
    """
    if environment.space is None or isinstance(environment.space, Prisms):
        return None
    space = copy.copy(environment.space)
    if isinstance(space, Mesh):
        space.processes = 1
    return space
