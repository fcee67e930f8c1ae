"""Pairs of aliased regions: neighbouring poses whose aliased poses are also neighbours."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ambinav.layers.aliasing.layer import AliasedPoses
from ambinav.layers.context import LayerContext
from ambinav.runtime.array_types import Bools, Floats, Indices
from ambinav.studies.audit.aliasing_groups import Cells, join
from ambinav.studies.audit.aliasing_tracks import LEAST_LIKENESS

LEAST_DISTANCE = 1.5
"""Least metres between the poses of a pair: the map itself shows the nearer ones. The other ends of
the pairs of one letter are at least as far apart."""
LEAST_AREA = 0.5
"""Least square metres of a region that is listed."""
LEAST_CELLS = 4
"""Cells of one on a coarse lattice: fewer may be alike by chance."""
LEAST_SHARE = 0.1
"""Share of the largest region from which one gets a letter, and of a letter's first from which
others are paired with it: less is what is left over from large ones."""


@dataclass(frozen=True, eq=False)
class AliasedPair:
    """A region and a second region from which the scanner sees the same.

    Attributes:
        letter: "A" for the strongest; pairs of one letter start at the same point.
        x: Metres, map frame; a point of the region.
        y: Metres.
        other_x: Metres, map frame; the pose it is aliased with.
        other_y: Metres.
        turn: Radians in (-pi, pi]: how much the robot is turned there.
        likeness: Mean of the scans' likeness over the region, in (0, 1].
        area: Square metres of the region.
        cells: The region's poses, x and y, shape (M, 2).
        images: The poses they are aliased with, shape (M, 2).
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
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Start pose and aliased pose as two points (x, y), metres."""
        return (self.x, self.y), (self.other_x, self.other_y)

    @property
    def distance(self) -> float:
        """Distance between the two points, metres."""
        return math.dist(*self.ends)


def find_aliased_pairs(
    context: LayerContext, aliased: AliasedPoses, letters: int
) -> tuple[AliasedPair, ...]:
    """Join neighbouring poses whose aliased poses are neighbours with the same offset.

    Cells are joined along lattice steps while their aliased poses are where `stepped` expects them.
    The largest region, by likeness times area, gets the first letter, and with it all regions that
    one point of it looks like; then the largest among the rest of the floor, without what looks
    like one of these.

    Args:
        context: Context with the poses.
        aliased: Their aliased poses.
        letters: How many letters at most, up to 26.
    """
    entries = aliased.poses.reshape(len(aliased.poses), -1, 4)
    x, y = context.points
    distance = np.hypot(entries[..., 0] - x[:, None], entries[..., 1] - y[:, None])
    # NaN is no aliased pose, and compares as False.
    linked = (entries[..., 3] >= LEAST_LIKENESS) & (distance >= LEAST_DISTANCE)
    least = max(LEAST_CELLS, math.ceil(LEAST_AREA / context.spacing**2))
    regions = join(context, entries, linked, least)
    weight = np.array([entries[region][:, 3].sum() for region in regions])
    region_of = np.full(linked.shape, -1)
    for r, region in enumerate(regions):
        region_of[region] = r
    points = cKDTree(np.column_stack([x, y]))
    aliased_cells = [points.query(entries[region][:, :2])[1] for region in regions]
    large = weight >= LEAST_SHARE * weight.max(initial=0.0)
    pairs: list[AliasedPair] = []
    shown = np.zeros(len(x), dtype=np.bool_)
    letter = 0
    for i in np.argsort(-weight, kind="stable").tolist():
        cells = regions[i][0]
        if letter == letters or not large[i]:
            break
        if shown[cells].mean() > 0.5:
            continue
        notable = (region_of >= 0) & (weight[region_of] >= LEAST_SHARE * weight[i])
        start = _start_cell(x, y, notable.sum(axis=1), distance, regions[i])
        at = float(x[start]), float(y[start])
        if any(math.dist(at, end) < LEAST_DISTANCE for pair in pairs for end in pair.ends):
            continue
        alias = {int(region_of[start, c]): c for c in np.flatnonzero(notable[start])}
        # Regions shown by an earlier letter are not listed again.
        alias = {r: c for r, c in alias.items() if shown[regions[r][0]].mean() <= 0.5}
        places: list[tuple[float, float]] = []
        for r in sorted(alias, key=lambda r: (r != i, -weight[r])):
            pair = _make_pair(context, chr(ord("A") + letter), start, entries[start, alias[r]],
                         entries[regions[r]], regions[r][0])  # fmt: skip
            # Where a region looks like itself along a wall, one pair stands for its neighbours.
            place = pair.other_x, pair.other_y
            if all(math.dist(place, shown_place) >= LEAST_DISTANCE for shown_place in places):
                places.append(place)
                pairs.append(pair)
            shown[regions[r][0]] = True
            shown[aliased_cells[r]] = True
        _mark_aliased(
            shown, [(region[0], aliased_cells[r]) for r, region in enumerate(regions) if large[r]]
        )
        letter += 1
    return tuple(pairs)


def _mark_aliased(shown: Bools, regions: list[tuple[Cells, Cells]]) -> None:
    """Mark as shown every region aliased with a region of which more than half is shown."""
    before = -1
    while shown.sum() > before:
        before = shown.sum()
        for cells, aliased_cells in regions:
            if shown[cells].mean() > 0.5:
                shown[aliased_cells] = True


def _start_cell(
    x: Floats, y: Floats, match_count: Indices, match_distance: Floats, region: tuple[Cells, Cells]
) -> int:
    """Choose the start cell of a region's pairs.

    Among the cells that lie in most regions, take those with the farthest aliased poses, and of
    these the middle one.
    """
    cells, distance = region[0], match_distance[region]
    rich = match_count[cells] == match_count[cells].max()
    cells, distance = cells[rich], distance[rich]
    far = cells[distance >= 0.9 * distance.max()]
    return int(far[np.hypot(x[far] - x[far].mean(), y[far] - y[far].mean()).argmin()])


def _make_pair(
    context: LayerContext, letter: str, start: int, alias: Floats, alike: Floats, cells: Cells
) -> AliasedPair:
    """Describe the region `cells` with the aliased poses `alike`, seen from the cell `start`."""
    x, y = context.points
    return AliasedPair(
        letter=letter,
        x=round(float(x[start]), 6),
        y=round(float(y[start]), 6),
        other_x=float(alias[0]),
        other_y=float(alias[1]),
        turn=float(alias[2]),
        likeness=float(alike[:, 3].mean()),
        area=len(cells) * context.spacing**2,
        cells=np.column_stack([x[cells], y[cells]]),
        images=alike[:, :2].copy(),
    )
