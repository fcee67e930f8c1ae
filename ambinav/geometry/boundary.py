"""From an occupancy grid to the walls and frontiers around its free space."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.collision_geometry import drivable_space
from ambinav.geometry.contour import Contours, trace
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy import OccupancyGrid
from ambinav.geometry.segments import FRONTIER, WALL, Segments
from ambinav.geometry.simplify import furthest, simplify_ring

TOLERANCE_CELLS: Final = 2.0
GAP_CELLS: Final = 1
# On a coarse grid a single cell is a passage, not a crack in a wall.
LARGEST_DEFAULT_GAP: Final = 0.1
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
    """Straight walls and frontiers around the free space of an occupancy grid.

    Args:
        grid: The occupancy grid.
        tolerance: How far in metres a wall's cells may lie from its straight segment; two cells
            by default. Curved walls are followed to a quarter of it. 0 keeps every step.
        gap: Openings in walls up to this width in metres are closed; one cell by default, but
            none where a cell is larger than 0.1 m. Islands in the free space of up to gap x gap
            (3 gap x 3 gap where nothing in them is known to be occupied) are taken for noise;
            with `gap=0` the leg of a chair that fills a single cell stays.
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
    if gap is None:
        gap = GAP_CELLS * cell if cell <= LARGEST_DEFAULT_GAP else 0.0
    for key, value in (("tolerance", tolerance), ("gap", gap), ("min_area", min_area)):
        if not (math.isfinite(value) and value >= 0.0):
            raise InputError(f"{key} is {value!r}; it must be a length of at least 0 in metres.")
    name = grid.source.stem if grid.source is not None else "grid"
    # A little above whole cells is whole cells: 0.15 / 0.05 is 2.9999999999999996.
    gap_cells = math.floor(gap / cell + 1e-6)
    steps = tolerance / cell
    contours = trace(
        grid.state,
        gap=gap_cells,
        min_cells=max(min_area / cell**2, 1.0),
        reach=min(max(round(steps), 1), LARGEST_REACH_CELLS),
    )
    if len(contours.component) == 0:
        raise InputError(
            f"{grid.source or name}: no piece of free space has {min_area:g} m^2 once gaps of "
            f"{gap:g} m are closed; check resolution {cell:g}, or lower gap."
        )
    notes = []
    while True:
        rings = _Rings(contours, steps)
        rings.untangle()
        free, edges, kind = rings.assemble(grid)
        if free.is_valid:
            break
        if steps == 0.0:
            raise InputError(
                f"{grid.source or name}: the origin {grid.origin} is too far from 0 for cells of "
                f"{cell:g} m; move it nearer."
            )
        # Not seen on any map so far; the contours themselves are valid but for rounding.
        steps = 0.5 * steps if steps > 0.25 else 0.0
        notes.append(f"Walls follow the grid to {steps * cell:g} m: coarser ones would cross.")
    return Environment(
        Segments(edges, kind),
        free,
        name=name,
        source=grid.source,
        checksum=grid.checksum,
        resolution=cell,
        notes=tuple(notes),
        drivable=drivable_space(grid, free),
    )


class _Rings:
    """The simplified rings of a grid, in cells, while they are being made."""

    def __init__(self, contours: Contours, tolerance: float) -> None:
        self.component: list[int] = []
        self.outer: list[bool] = []
        self.points: list[NDArray[np.float64]] = []
        self.kind: list[NDArray[np.uint8]] = []
        self.index: list[NDArray[np.int64]] = []
        self.place: list[NDArray[np.float64]] = []
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
        """Go back towards the contour's own points wherever simplified edges cross or touch."""
        while True:
            owner, number, edges = self._edges()
            bad = crossing(edges, owner)
            if not bad.any():
                return
            touched = {int(k) for k in owner[bad]}
            for k in touched:
                self._refine(k, number[bad & (owner == k)])

    def assemble(
        self, grid: OccupancyGrid
    ) -> tuple[shapely.Polygon | shapely.MultiPolygon, NDArray[np.float64], NDArray[np.uint8]]:
        """Free space, edges (N, 4) and their kinds in the map frame."""
        world = [np.stack(grid.to_world(p[:, 0], p[:, 1]), axis=1) for p in self.place]
        linear = [shapely.linearrings(p) for p in world]
        shells = {c: k for k, c in enumerate(self.component) if self.outer[k]}
        solid = {c: shapely.Polygon(linear[k]) for c, k in shells.items()}
        holes: dict[int, list[int]] = {c: [] for c in shells}
        for k, c in enumerate(self.component):
            if not self.outer[k]:
                holes[c].append(k)
        polygons, used = [], []
        for c, shell in shells.items():
            # A pillar beside a wall can end up within the wall's tolerance: it is part of it.
            mine = np.array(holes[c], dtype=np.int64)
            if len(mine):
                shapely.prepare(solid[c])
                mine = mine[[bool(solid[c].contains(linear[k])) for k in mine]]
            polygons.append(shapely.Polygon(linear[shell], [linear[k] for k in mine]))
            used += [shell, *mine.tolist()]
        edges = [np.hstack([world[k], np.roll(world[k], -1, axis=0)]) for k in used]
        kinds = [self.kind[k][self.index[k]] for k in used]
        free = polygons[0] if len(polygons) == 1 else shapely.MultiPolygon(polygons)
        return free, np.concatenate(edges), np.concatenate(kinds)

    def _edges(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Ring and number within the ring of each edge, and its end points, shape (N, 4)."""
        count = [len(place) for place in self.place]
        owner = np.repeat(np.arange(len(count)), count)
        number = np.concatenate([np.arange(n) for n in count])
        edges = [np.hstack([place, np.roll(place, -1, axis=0)]) for place in self.place]
        return owner, number, np.concatenate(edges)

    def _refine(self, k: int, edges: NDArray[np.int64]) -> None:
        """Put the ends of these edges of ring k back on the contour; if there, add a point."""
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
            index = np.append(index, added)
            order = np.argsort(index)
            self.index[k] = index[order]
            self.place[k] = np.concatenate([place, xy[added]])[order]


def without_short_frontiers(
    kind: NDArray[np.uint8], shortest: int = SHORTEST_FRONTIER_CELLS
) -> NDArray[np.uint8]:
    """Kinds of the points of a ring with runs of fewer than `shortest` frontier points walls."""
    change = np.flatnonzero(kind != np.roll(kind, 1))
    if len(change) == 0:
        return kind
    length = np.diff(np.append(change, change[0] + len(kind)))
    kind = kind.copy()
    for first, count in zip(change, length, strict=True):
        if kind[first] == FRONTIER and count < shortest:
            kind[np.arange(first, first + count) % len(kind)] = WALL
    return kind


def crossing(edges: NDArray[np.float64], owner: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Edges that cross or touch another one, other than at the end that neighbours share.

    Args:
        edges: shape (N, 4), end points; the edges of a ring follow one another.
        owner: shape (N,), the ring of each edge, ascending.
    """
    n = len(edges)
    following = np.arange(1, n + 1)
    first = np.searchsorted(owner, owner)
    last = np.searchsorted(owner, owner, side="right") - 1
    following[last] = first[last]
    lines = shapely.linestrings(edges.reshape(n, 2, 2))
    tree = shapely.STRtree(lines)
    a, b = tree.query(lines, predicate="intersects")
    real = (a < b) & (following[a] != b) & (following[b] != a)
    bad = np.zeros(n, dtype=np.bool_)
    bad[a[real]] = bad[b[real]] = True
    # Neighbours share an end; they overlap if they run back on each other.
    run = edges[:, 2:] - edges[:, :2]
    after = run[following]
    turn = run[:, 0] * after[:, 1] - run[:, 1] * after[:, 0]
    along = (run * after).sum(axis=1)
    size = np.hypot(run[:, 0], run[:, 1]) * np.hypot(after[:, 0], after[:, 1])
    back = ((along < 0.0) & (np.abs(turn) <= 1e-9 * size)) | (size < 1e-9)
    bad[back] = bad[following[back]] = True
    return bad
