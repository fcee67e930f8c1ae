"""Raster of a regular lattice in the map frame: cells in polygons, cells that lines cross."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.geometry.even_odd import lattice_inside
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.errors import InputError


@dataclass(frozen=True)
class Raster:
    """Raster of square cells; row 0 lies at the smallest y, as everywhere in ambinav.

    Attributes:
        x: x of the outer corner of cell (0, 0), metres, map frame.
        y: As `x`.
        resolution: Edge of a cell, metres.
        shape: Rows and columns.
    """

    x: float
    y: float
    resolution: float
    shape: tuple[int, int]

    @classmethod
    def of_map(cls, amap: AmbiguityMap) -> Raster:
        """Return the cells of a map's own lattice.

        Raises:
            InputError: its cells are not square.
        """
        xmin, ymin, xmax, ymax = amap.bounds
        ny, nx = (amap.dataset.sizes[name] for name in ("y", "x"))
        wide, tall = (xmax - xmin) / nx, (ymax - ymin) / ny
        if not math.isclose(wide, tall, rel_tol=1e-6):
            raise InputError(
                f"{amap.source}: its cells measure {wide:g} x {tall:g} m, and the formats of other "
                "programs have square ones; make the map with `ambinav map`."
            )
        return cls(_short(xmin), _short(ymin), _short(wide), (ny, nx))

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(xmin, ymin, xmax, ymax), edges of the outermost cells, metres."""
        ny, nx = self.shape
        size = self.resolution
        return self.x, self.y, self.x + nx * size, self.y + ny * size

    def inside(self, geometry: BaseGeometry) -> Bools:
        """Return the cells whose centre lies in polygons, bool, shape (ny, nx)."""
        ny, nx = self.shape
        x = self.x + (np.arange(nx) + 0.5) * self.resolution
        y = self.y + (np.arange(ny) + 0.5) * self.resolution
        return lattice_inside(geometry, x, y)

    def crossed(self, segments: Floats) -> Bools:
        """Return the cells that segments (N, 4) cross, bool, shape (ny, nx)."""
        ax, ay = self._in_cells(segments[:, :2])
        bx, by = self._in_cells(segments[:, 2:])
        owners, places = [np.tile(np.arange(len(segments)), 2)], [np.repeat([0.0, 1.0], len(ax))]
        for a, b in ((ax, bx), (ay, by)):
            which, line = _spans(
                np.ceil(np.minimum(a, b)).astype(np.int64),
                np.floor(np.maximum(a, b)).astype(np.int64) + 1,
            )
            moving = (b != a)[which]
            which, line = which[moving], line[moving]
            owners.append(which)
            places.append((line - a[which]) / (b - a)[which])
        owner, place = np.concatenate(owners), np.clip(np.concatenate(places), 0.0, 1.0)
        order = np.lexsort((place, owner))
        owner, place = owner[order], place[order]
        # Between two crossings in a row a segment stays in one cell: that of the middle.
        same = owner[1:] == owner[:-1]
        middle, which = (0.5 * (place[1:] + place[:-1]))[same], owner[1:][same]
        column = np.floor(ax[which] + middle * (bx - ax)[which]).astype(np.int64)
        row = np.floor(ay[which] + middle * (by - ay)[which]).astype(np.int64)
        ny, nx = self.shape
        within = (column >= 0) & (column < nx) & (row >= 0) & (row < ny)
        mask = np.zeros(self.shape, dtype=np.bool_)
        mask[row[within], column[within]] = True
        return mask

    def outline(self, mask: Bools) -> shapely.MultiPolygon:
        """Return the pieces that cells form, with holes; cells join along edges.

        Rings are ordered as RFC 7946 has them: outer ones counter-clockwise.
        """
        ny, nx = self.shape
        padded = np.zeros((ny, nx + 2), dtype=np.int8)
        padded[:, 1:-1] = mask
        step = np.diff(padded, axis=1)
        row, begin = np.nonzero(step == 1)
        end = np.nonzero(step == -1)[1]
        size = self.resolution
        # Corners are counted before they become metres, so that neighbours share theirs exactly.
        strips = shapely.box(begin, row, end, row + 1)
        outline = shapely.simplify(shapely.union_all(strips), 0.0)  # without points on its edges
        scaled = shapely.transform(outline, lambda cell: cell * size + [self.x, self.y])
        parts = [part for part in shapely.get_parts(scaled) if not part.is_empty]
        return shapely.MultiPolygon(list(shapely.orient_polygons(parts)))

    def _in_cells(self, points: Floats) -> tuple[Floats, Floats]:
        return (points[:, 0] - self.x) / self.resolution, (points[:, 1] - self.y) / self.resolution


def _short(value: float) -> float:
    """Round a length to remove the last digits of float sums: 0.1, not 0.09999999999999998."""
    return float(np.round(value, 9))


def _spans(first: Ints, after: Ints) -> tuple[Ints, ...]:
    """Return all whole numbers of half-open intervals, and the interval of each."""
    count = np.maximum(after - first, 0)
    which = np.repeat(np.arange(len(count)), count)
    begin = np.cumsum(count) - count
    return which, np.arange(count.sum()) - begin[which] + first[which]
