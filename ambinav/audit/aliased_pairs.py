"""Pairs of regions that look alike: poses whose look-alikes move along as they do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.ambiguity.layers.aliasing.layer import AliasedPoses
from ambinav.ambiguity.layers.context import LayerContext
from ambinav.audit.aliasing_groups import Cells, join
from ambinav.audit.aliasing_tracks import LEAST_LIKENESS

Floats = NDArray[np.float64]

LEAST_DISTANCE = 1.5
"""Metres from which two poses are linked: nearer ones the map itself tells of. Links of one letter
end at least so far apart."""
LEAST_AREA = 0.5
"""Square metres of a region that is worth a link."""
LEAST_CELLS = 4
"""Cells of one on a coarse lattice: fewer may be alike by chance."""
LEAST_SHARE = 0.1
"""Share of the largest region from which one gets a letter, and of a letter's first from which
others are linked with it: less is what is left over from large ones."""


@dataclass(frozen=True, eq=False)
class AliasedPair:
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
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """The two points."""
        return (self.x, self.y), (self.other_x, self.other_y)

    @property
    def distance(self) -> float:
        """Metres between the two points."""
        return math.dist(*self.ends)


def find_aliased_pairs(
    ground: LayerContext, found: AliasedPoses, letters: int
) -> tuple[AliasedPair, ...]:
    """Join neighbouring poses whose look-alikes are neighbours in the same arrangement.

    Cells are joined along lattice steps while their look-alikes are where `stepped` expects them.
    The largest region, by likeness times area, gets the first letter, and with it all regions that
    one point of it looks like; then the largest among the rest of the floor, without what looks
    like one of these.

    Args:
        ground: Where the poses are.
        found: Their look-alikes.
        letters: How many letters at most, up to 26.
    """
    entries = found.found.reshape(len(found.found), -1, 4)
    x, y = ground.points
    apart = np.hypot(entries[..., 0] - x[:, None], entries[..., 1] - y[:, None])
    # NaN is no look-alike, and compares as False.
    linked = (entries[..., 3] >= LEAST_LIKENESS) & (apart >= LEAST_DISTANCE)
    least = max(LEAST_CELLS, math.ceil(LEAST_AREA / ground.spacing**2))
    regions = join(ground, entries, linked, least)
    weight = np.array([entries[region][:, 3].sum() for region in regions])
    region_of = np.full(linked.shape, -1)
    for r, region in enumerate(regions):
        region_of[region] = r
    points = cKDTree(np.column_stack([x, y]))
    looks_like = [points.query(entries[region][:, :2])[1] for region in regions]
    large = weight >= LEAST_SHARE * weight.max(initial=0.0)
    links: list[AliasedPair] = []
    shown = np.zeros(len(x), dtype=np.bool_)
    letter = 0
    for i in np.argsort(-weight, kind="stable").tolist():
        cells = regions[i][0]
        if letter == letters or not large[i]:
            break
        if shown[cells].mean() > 0.5:
            continue
        notable = (region_of >= 0) & (weight[region_of] >= LEAST_SHARE * weight[i])
        start = _start(x, y, notable.sum(axis=1), apart, regions[i])
        at = float(x[start]), float(y[start])
        if any(math.dist(at, end) < LEAST_DISTANCE for link in links for end in link.ends):
            continue
        own = {int(region_of[start, c]): c for c in np.flatnonzero(notable[start])}
        # What an earlier letter tells of is not told again.
        own = {r: c for r, c in own.items() if shown[regions[r][0]].mean() <= 0.5}
        places: list[tuple[float, float]] = []
        for r in sorted(own, key=lambda r: (r != i, -weight[r])):
            link = _link(ground, chr(ord("A") + letter), start, entries[start, own[r]],
                         entries[regions[r]], regions[r][0])  # fmt: skip
            # Where a region looks like itself along a wall, one link stands for its neighbours.
            place = link.other_x, link.other_y
            if all(math.dist(place, other) >= LEAST_DISTANCE for other in places):
                places.append(place)
                links.append(link)
            shown[regions[r][0]] = True
            shown[looks_like[r]] = True
        _spread(shown, [(region[0], looks_like[r]) for r, region in enumerate(regions) if large[r]])
        letter += 1
    return tuple(links)


def _spread(shown: NDArray[np.bool_], regions: list[tuple[Cells, Cells]]) -> None:
    """What looks like a region that is shown, by half of its cells, is shown with it."""
    before = -1
    while shown.sum() > before:
        before = shown.sum()
        for cells, looks_like in regions:
            if shown[cells].mean() > 0.5:
                shown[looks_like] = True


def _start(
    x: Floats, y: Floats, many: NDArray[np.intp], apart: Floats, region: tuple[Cells, Cells]
) -> int:
    """A region's cell to link: of those in most regions the middle of the farthest linked."""
    cells, distance = region[0], apart[region]
    rich = many[cells] == many[cells].max()
    cells, distance = cells[rich], distance[rich]
    far = cells[distance >= 0.9 * distance.max()]
    return int(far[np.hypot(x[far] - x[far].mean(), y[far] - y[far].mean()).argmin()])


def _link(
    ground: LayerContext, letter: str, start: int, there: Floats, alike: Floats, cells: Cells
) -> AliasedPair:
    """Describe the region of `cells`, whose look-alikes are `alike`, at the cell `start`."""
    x, y = ground.points
    return AliasedPair(
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
