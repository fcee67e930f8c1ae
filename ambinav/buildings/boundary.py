"""Conversion of an occupancy grid to the walls and frontiers around its free space."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from ambinav.buildings.contour import Contours, trace
from ambinav.buildings.coverage import Coverage
from ambinav.buildings.edge_fit import furthest, strays
from ambinav.buildings.ring_checks import crossing, enclosures
from ambinav.buildings.simplify import simplify_ring
from ambinav.config import as_nonnegative
from ambinav.geometry.collision.collision_geometry import drivable_space
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import OccupancyGrid
from ambinav.geometry.segments import FRONTIER, WALL, Segments
from ambinav.runtime.array_types import Bytes, Floats, Ints
from ambinav.runtime.errors import InputError

TOLERANCE_CELLS: Final = 2.0
# Unknown cells may lie this much further from the frontier than a wall's cells from the wall.
FRONTIER_SLACK: Final = 1.25
GAP_CELLS: Final = 1
# On a coarse grid a single cell is a passage, not a crack in a wall.
LARGEST_DEFAULT_GAP: Final = 0.1
# Above this a single occupied cell is a post, not noise of a scanner, metres.
LARGEST_DEFAULT_SPECK: Final = 0.06
MIN_AREA: Final = 0.25
# In a rough map the cells of a wall lie this far apart from the cells that were seen free.
LARGEST_REACH_CELLS: Final = 3
# A shorter stretch of frontier in a wall is a wall whose cells were not all seen.
SHORTEST_FRONTIER_CELLS: Final = 8
# Points around an island of 4 x 4 cells.
PILLAR_POINTS: Final = 16


def environment_from_grid(
    grid: OccupancyGrid,
    *,
    tolerance: float | None = None,
    gap: float | None = None,
    min_area: float = MIN_AREA,
) -> Environment:
    """Build straight walls and frontiers around the free space of an occupancy grid.

    Args:
        grid: The occupancy grid.
        tolerance: How far in metres a wall's cells may lie from its straight segment; two cells
            by default. Curved walls are followed to a quarter of it. 0 keeps every step.
        gap: Openings in walls up to this width in metres are closed; one cell by default, but
            none where a cell is larger than 0.1 m. Islands in the free space of up to gap x gap
            (3 gap x 3 gap where nothing in them is known to be occupied) are taken for noise;
            by default none where a cell is larger than 0.06 m: that is a post. With `gap=0` the
            leg of a chair that fills a single cell stays.
        min_area: Separate pieces of free space below this area in square metres are left out.

    Returns:
        The environment in the map frame. Its segments are the edges of its free space, free
        space on their left; a segment is a frontier where free cells border on unknown ones, or
        on the rim of the image, and no occupied cell is near.

    Raises:
        InputError: A parameter is negative or not finite, or no piece of free space is large
            enough.
    """
    cell = grid.resolution
    if tolerance is None:
        tolerance = TOLERANCE_CELLS * cell
    specks_stay = gap is None and cell > LARGEST_DEFAULT_SPECK * (1 + 1e-6)
    if gap is None:
        gap = GAP_CELLS * cell if cell <= LARGEST_DEFAULT_GAP else 0.0
    tolerance = as_nonnegative(tolerance, "tolerance", "metres")
    gap = as_nonnegative(gap, "gap", "metres")
    min_area = as_nonnegative(min_area, "min_area", "square metres")
    name = grid.source.stem if grid.source is not None else "grid"
    # Add a margin before rounding down: 0.15 / 0.05 is 2.9999999999999996.
    gap_cells = math.floor(gap / cell + 1e-6)
    steps = tolerance / cell
    contours = trace(
        grid.state,
        gap=gap_cells,
        min_cells=max(min_area / cell**2, 1.0),
        reach=min(max(round(steps), 1), LARGEST_REACH_CELLS),
        speck=0 if specks_stay else None,
    )
    if len(contours.component) == 0:
        raise InputError(
            f"{grid.source or name}: no piece of free space has {min_area:g} m^2 once gaps of "
            f"{gap:g} m are closed; check resolution {cell:g} and the thresholds of the map."
        )
    notes = []
    while True:
        rings = _Rings(contours, steps)
        rings.untangle()
        free, edges, kind = rings.assemble(grid)
        while not free.is_valid and rings.unnest():
            rings.untangle()
            free, edges, kind = rings.assemble(grid)
        if free.is_valid:
            break
        if steps == 0.0:
            raise InputError(
                f"{grid.source or name}: the origin {grid.origin} is too far from 0 for cells of "
                f"{cell:g} m; move it nearer."
            )
        # Never observed on a map; the contours themselves are valid except for rounding.
        steps = 0.5 * steps if steps > 0.25 else 0.0
        notes.append(f"Walls follow the grid to {steps * cell:g} m: coarser ones would cross.")
    notes += _coverage(grid, contours, free, gap, min_area)
    return Environment(
        Segments(edges, kind),
        free,
        name=name,
        source=grid.source,
        checksum=grid.checksum,
        resolution=cell,
        notes=tuple(notes),
        extent=shapely.Polygon(grid.outline()),
        occupancy=grid,
        drivable=drivable_space(grid, free),
    )


def _coverage(
    grid: OccupancyGrid, contours: Contours, free: BaseGeometry, gap: float, min_area: float
) -> list[str]:
    """List the free cells that do not become floor, as notes."""
    # Scanners see many of these through windows and legs of chairs.
    specks = f"each is smaller than {min_area:g} m²"
    coverage = Coverage(f"{grid.source or 'grid'}", expected=(specks,))
    square = grid.resolution**2
    for (cells, pieces), why in (
        (contours.small, specks),
        (contours.narrow, f"they are no wider than {gap:g} m, which gap closes"),
    ):
        coverage.left_out.append((cells * square, pieces, why))
    return coverage.notes(free, stacklevel=5)


class _Rings:
    """Simplified rings of a grid, in cells, while they are built."""

    def __init__(self, contours: Contours, tolerance: float) -> None:
        # A cell's centre lies half a cell behind the contour: it cannot come any nearer.
        nearest = max(tolerance, 0.75 * tolerance + 0.5) if tolerance > 0.0 else math.inf
        self.limit = np.array([nearest, FRONTIER_SLACK * nearest])
        self.component: list[int] = []
        self.outer: list[bool] = []
        self.points: list[Floats] = []
        self.kind: list[Bytes] = []
        self.index: list[Ints] = []
        self.place: list[Floats] = []
        for k, component in enumerate(contours.component):
            piece = slice(contours.start[k], contours.start[k + 1])
            xy = contours.xy[piece]
            kind = without_short_frontiers(contours.kind[piece])
            # A pillar of few cells keeps its shape, a thin wall its two sides.
            thickness = 2.0 * abs(contours.area[k]) / len(xy)
            finest = max(0.5 * thickness, 0.75) if len(xy) > PILLAR_POINTS else 0.25
            index, place = simplify_ring(xy[:, 0], xy[:, 1], kind, min(tolerance, finest))
            self.component.append(int(component))
            self.outer.append(bool(contours.area[k] > 0))
            self.points.append(xy)
            self.kind.append(kind)
            self.index.append(index)
            self.place.append(place)

    def untangle(self) -> None:
        """Move back towards the contour's points wherever edges cross, touch, or lie too far."""
        fresh = set(range(len(self.place)))
        while fresh:
            for k in fresh:
                self._follow(k)
            owner, number, edges = self._edges()
            bad = crossing(edges, owner)
            fresh = {int(k) for k in owner[bad]}
            for k in fresh:
                self._refine(k, number[bad & (owner == k)])

    def unnest(self) -> bool:
        """Separate rings that lie within each other where the contours do not, or the reverse.

        A pillar beside a wall can end up behind the wall's edge. Returns whether there were any.
        """
        wrong = sorted(enclosures(self.points) ^ enclosures(self.place))
        for pair in wrong:
            moved = False
            for k, other in (pair, pair[::-1]):
                place = self.place[k]
                lines = shapely.linestrings(np.stack([place, np.roll(place, -1, axis=0)], axis=1))
                away = shapely.distance(lines, shapely.linearrings(self.place[other]))
                moved |= self._refine(k, np.flatnonzero(away <= away.min()))
            if not moved:
                for k in pair:
                    self.index[k] = np.arange(len(self.points[k]))
                    self.place[k] = self.points[k].copy()
        return bool(wrong)

    def assemble(
        self, grid: OccupancyGrid
    ) -> tuple[shapely.Polygon | shapely.MultiPolygon, Floats, Bytes]:
        """Return free space, edges (N, 4) and their kinds in the map frame."""
        world = [np.stack(grid.to_world(p[:, 0], p[:, 1]), axis=1) for p in self.place]
        linear = [shapely.linearrings(p) for p in world]
        shells = {c: k for k, c in enumerate(self.component) if self.outer[k]}
        holes: dict[int, list[int]] = {c: [] for c in shells}
        for k, c in enumerate(self.component):
            if not self.outer[k]:
                holes[c].append(k)
        polygons = [
            shapely.Polygon(linear[k], [linear[hole] for hole in holes[c]])
            for c, k in shells.items()
        ]
        edges = [np.hstack([xy, np.roll(xy, -1, axis=0)]) for xy in world]
        kinds = [kind[index] for kind, index in zip(self.kind, self.index, strict=True)]
        free = polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
        return free, np.concatenate(edges), np.concatenate(kinds)

    def _edges(self) -> tuple[Ints, Ints, Floats]:
        """Return ring and index within the ring of each edge, and its end points, (N, 4)."""
        count = [len(place) for place in self.place]
        owner = np.repeat(np.arange(len(count)), count)
        number = np.concatenate([np.arange(n) for n in count])
        edges = [np.hstack([place, np.roll(place, -1, axis=0)]) for place in self.place]
        return owner, number, np.concatenate(edges)

    def _follow(self, k: int) -> None:
        """Add vertices to ring k until all its points are near it.

        The edge stays on its line up to where the points leave it, and from where they are back.
        """
        xy, n = self.points[k], len(self.points[k])
        while True:
            index, place = self.index[k], self.place[k]
            stretches = strays(xy[:, 0], xy[:, 1], self.kind[k], index, place, self.limit)
            if len(stretches) == 0:
                return
            added: list[int] = []
            there: list[Floats] = []
            for j, before, after, far in stretches:
                start, end = place[j], place[(j + 1) % len(place)]
                a, b = int(index[j]), int(index[(j + 1) % len(index)])
                b += n if b <= a else 0
                if far == a:
                    place[j] = xy[a]
                    continue
                run = end - start
                # Not by @: BLAS rounds it in another way on each kind of processor.
                square = max(float((run * run).sum()), 1e-18)
                t = [
                    float(((xy[i % n] - start) * run).sum()) / square for i in (before, far, after)
                ]
                if a < before and 0.0 < t[0] < min(t[1], 1.0):
                    added.append(before % n)
                    there.append(start + t[0] * run)
                if after < b and max(t[1], 0.0) < t[2] < 1.0:
                    added.append(after % n)
                    there.append(start + t[2] * run)
                added.append(far % n)
                there.append(xy[far % n])
            if added:
                self._insert(k, added, there)

    def _insert(self, k: int, added: list[int], there: list[Floats]) -> None:
        """Add vertices to ring k: the indices of their points, and their positions."""
        index = np.append(self.index[k], added)
        order = np.argsort(index)
        self.index[k] = index[order]
        self.place[k] = np.concatenate([self.place[k], np.array(there)])[order]

    def _refine(self, k: int, edges: Ints) -> bool:
        """Move the ends of these edges of ring k back to the contour; if there, add a point.

        Returns whether anything was left to do.
        """
        xy, index, place = self.points[k], self.index[k], self.place[k]
        n, m = len(xy), len(index)
        ends = np.union1d(edges, (edges + 1) % m)
        moved = np.flatnonzero((place[ends] != xy[index[ends]]).any(axis=1))
        added: list[int] = []
        if len(moved) == 0:
            for j in edges:
                a = int(index[j])
                b = int(index[(j + 1) % m])
                b += n if b <= a else 0
                between = np.arange(a, b + 1) % n
                i, _ = furthest(xy[between, 0], xy[between, 1], 0, len(between) - 1)
                if i >= 0:
                    added.append(int(between[i]))
        place[ends] = xy[index[ends]]
        if added:
            self._insert(k, added, [xy[i] for i in added])
        return len(moved) > 0 or len(added) > 0


def without_short_frontiers(kind: Bytes) -> Bytes:
    """Turn runs of fewer than `SHORTEST_FRONTIER_CELLS` frontier points of a ring into walls."""
    change = np.flatnonzero(kind != np.roll(kind, 1))
    if len(change) == 0:
        return kind
    length = np.diff(np.append(change, change[0] + len(kind)))
    kind = kind.copy()
    for first, count in zip(change, length, strict=True):
        if kind[first] == FRONTIER and count < SHORTEST_FRONTIER_CELLS:
            kind[np.arange(first, first + count) % len(kind)] = WALL
    return kind
