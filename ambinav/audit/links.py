"""Pairs of regions that look alike: poses whose look-alikes move along as they do."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.ambiguity.layers.aliasing import LookAlikes
from ambinav.ambiguity.layers.ground import Ground

Floats = NDArray[np.float64]

LEAST_LIKENESS = 0.3
"""Likeness from which two poses are linked."""
LEAST_DISTANCE = 1.5
"""Metres from which two poses are linked: nearer ones the map itself tells of. Links of one letter
end at least so far apart."""
LEAST_AREA = 0.5
"""Square metres of a region that is worth a link."""
SAME_TURN = 0.2
"""Radians by which the turns of neighbours may differ."""


@dataclass(frozen=True, eq=False)
class Link:
    """A region, and another one from which a scanner sees the same.

    Attributes:
        letter: "A" for the strongest; links of one letter start at the same point.
        x: Metres; a point of the region.
        y: Metres.
        other_x: Metres; its look-alike.
        other_y: Metres.
        turn: Radians in (-pi, pi]: how much the robot is turned there.
        likeness: Mean of the scans' likeness over the region, in (0, 1].
        area: Square metres of the region.
        cells: The region's poses, x and y, shape (M, 2).
        images: Their look-alikes, shape (M, 2).
    """

    letter: str
    x: float
    y: float
    other_x: float
    other_y: float
    turn: float
    likeness: float
    area: float
    cells: Floats
    images: Floats

    @property
    def distance(self) -> float:
        """Metres between the two points."""
        return math.hypot(self.other_x - self.x, self.other_y - self.y)


def find_links(ground: Ground, found: LookAlikes, letters: int) -> tuple[Link, ...]:
    """Join neighbouring poses whose look-alikes are neighbours in the same arrangement.

    If p looks like q, turned by t, then a step s from p leads to a look-alike a step s, turned by
    t, from q. Cells are joined along lattice steps while that holds within half a spacing and
    `SAME_TURN`. The largest region, by likeness times area, gets the first letter, and with
    it all regions that one point of it looks like; then the largest among the rest of the floor.

    Args:
        ground: Where the poses are.
        found: Their look-alikes.
        letters: How many letters at most, up to 26.
    """
    entries = found.found.reshape(len(found.found), -1, 4)
    x, y = ground.points
    apart = np.hypot(entries[..., 0] - x[:, None], entries[..., 1] - y[:, None])
    # NaN is no look-alike, and compares as False.
    open_ = (entries[..., 3] >= LEAST_LIKENESS) & (apart >= LEAST_DISTANCE)
    region_of = np.full(open_.shape, -1)
    regions: list[tuple[list[int], list[int]]] = []
    order = np.argsort(-np.where(open_, entries[..., 3], -1.0), axis=None, kind="stable")
    for flat in order[: int(open_.sum())].tolist():
        cell, entry = divmod(flat, entries.shape[1])
        if open_[cell, entry]:
            grown = _grow(ground, entries, open_, cell, entry)
            region_of[grown] = len(regions)
            regions.append(grown)
    weight = np.array([entries[grown][:, 3].sum() for grown in regions])
    points = cKDTree(np.column_stack([x, y]))
    links: list[Link] = []
    shown = np.zeros(len(x), dtype=np.bool_)
    least = max(1, math.ceil(LEAST_AREA / ground.spacing**2))
    letter = 0
    for i in np.argsort(-weight, kind="stable").tolist():
        cells = regions[i][0]
        if letter == letters or len(cells) < least:
            break
        if shown[cells].mean() > 0.5:
            continue
        start = _start(x, y, apart, regions[i])
        own = {r for r in region_of[start].tolist() if r >= 0 and len(regions[r][0]) >= least}
        places: list[tuple[float, float]] = []
        for r in sorted(own, key=lambda r: (r != i, -weight[r])):
            there = entries[start, int(np.flatnonzero(region_of[start] == r)[0])]
            link = _link(ground, chr(ord("A") + letter), start, there, entries[regions[r]],
                         regions[r][0])  # fmt: skip
            # Where a region looks like itself along a wall, one link stands for its neighbours.
            place = link.other_x, link.other_y
            if all(math.dist(place, other) >= LEAST_DISTANCE for other in places):
                places.append(place)
                links.append(link)
            shown[regions[r][0]] = True
            shown[points.query(link.images)[1]] = True
        letter += 1
    return tuple(links)


def _grow(
    ground: Ground, entries: Floats, open_: NDArray[np.bool_], cell: int, entry: int
) -> tuple[list[int], list[int]]:
    """Cells joined to one of them, and which of their look-alikes; these are closed in `open_`."""
    index, places = ground.lattice.index, ground.lattice.rows_columns
    cells, chosen, todo = [cell], [entry], deque([(cell, entry)])
    open_[cell, entry] = False
    members = {cell}
    while todo:
        cell, entry = todo.popleft()
        row, column = places[cell]
        qx, qy, turn, _ = entries[cell, entry]
        for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1)):
            to_row, to_column = row + dy, column + dx
            if not (0 <= to_row < index.shape[0] and 0 <= to_column < index.shape[1]):
                continue
            to = int(index[to_row, to_column])
            if to < 0 or to in members or not open_[to].any():
                continue
            sx = ground.spacing * (dx * math.cos(turn) - dy * math.sin(turn))
            sy = ground.spacing * (dx * math.sin(turn) + dy * math.cos(turn))
            off = np.hypot(entries[to, :, 0] - qx - sx, entries[to, :, 1] - qy - sy)
            bend = np.abs(np.angle(np.exp(1j * (entries[to, :, 2] - turn))))
            fits = open_[to] & (off <= 0.5 * ground.spacing) & (bend <= SAME_TURN)
            if fits.any():
                best = int(np.argmin(np.where(fits, off, np.inf)))
                open_[to, best] = False
                members.add(to)
                cells.append(to)
                chosen.append(best)
                todo.append((to, best))
    return cells, chosen


def _start(x: Floats, y: Floats, apart: Floats, region: tuple[list[int], list[int]]) -> int:
    """The cell in the middle of those of a region that are farthest from their look-alikes."""
    cells = np.array(region[0])
    distance = apart[region]
    far = cells[distance >= 0.9 * distance.max()]
    return int(far[np.hypot(x[far] - x[far].mean(), y[far] - y[far].mean()).argmin()])


def _link(
    ground: Ground, letter: str, start: int, there: Floats, alike: Floats, cells: list[int]
) -> Link:
    """Describe the region of `cells`, whose look-alikes are `alike`, at the cell `start`."""
    x, y = ground.points
    return Link(
        letter=letter,
        x=round(float(x[start]), 6),
        y=round(float(y[start]), 6),
        other_x=float(there[0]),
        other_y=float(there[1]),
        turn=float(there[2]),
        likeness=float(alike[:, 3].mean()),
        area=len(cells) * ground.spacing**2,
        cells=np.column_stack([x[cells], y[cells]]),
        images=alike[:, :2].copy(),
    )
