"""Perceptual aliasing of a building for its audit: pairs of regions that give the same scans."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.layers.aliasing.layer import AliasedPoses, aliased_poses, squares
from ambinav.layers.aliasing.settle import settle
from ambinav.layers.context import LayerContext
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.runtime.array_types import Bools, Floats, Ints, Ints32
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.audit.aliased_pairs import AliasedPair, find_aliased_pairs
from ambinav.studies.audit.aliasing_tracks import follow

SPACING = 0.25
"""Metres between the poses that are compared; finer maps are sampled. Pairs grow with its -4th
power, and what lies between is found by the offset within a cell."""
MOST_POSES = 6000
"""Poses up to which aliased poses are sought without being asked for: about half a minute."""
WIDEST = 4
"""With more poses, the search starts from about `MOST_POSES` of them and goes on to the others:
from one square (`aliasing.squares`, 0.5 m wide at 0.25 m) in so many in each direction at the
least, so that no room is left out."""
COUNT = 20
"""Most aliased poses of one pose."""


@dataclass(frozen=True, eq=False)
class AliasingFindings:
    """Perceptual aliasing found by an audit.

    Attributes:
        poses: Poses of the lattice they were or would have been sought on: explored and reached.
        spacing: Spacing of that lattice, metres.
        sought: Whether they were sought.
        sought_from: Number of poses where the search started; the others were reached by tracking.
        share: Mean of `aliasing` over these poses, or over those that were sought from; NaN if
            they were not sought.
        area: Square metres of floor where `aliasing` is half or more, by the same poses.
        pairs: The strongest first.
    """

    poses: int
    spacing: float
    sought: bool
    sought_from: int = 0
    share: float = math.nan
    area: float = math.nan
    pairs: tuple[AliasedPair, ...] = ()


def find_aliasing(
    amap: AmbiguityMap,
    environment: Environment,
    wanted: bool | None = None,
    *,
    letters: int = 6,
    progress: Progress = silent,
) -> AliasingFindings:
    """Search a map for aliased poses and join them into pairs of regions.

    Poses off the judged floor take no part (`AmbiguityMap.judged`).

    Those in the pose's own corridor or hall are left out of the pairs, because the map itself shows
    that the robot can slide there; the share includes them.

    Args:
        amap: The map.
        environment: Building of the map.
        wanted: None: unless there are more than `MOST_POSES` poses; True: in any case.
        letters: Maximum number of regions to list with their aliased poses.
        progress: Called with the share done.
    """
    context = LayerContext.of(amap, environment)
    spacing = max(amap.spacing, min(SPACING, context.radius))
    if spacing > amap.spacing:
        context = context.over(Lattice.over(environment, spacing))
    context = dataclasses.replace(context, lattice=_restrict_to_judged(amap, context.lattice))
    poses = pose_count(context)
    if poses == 0 or not (poses <= MOST_POSES if wanted is None else wanted):
        return AliasingFindings(poses, spacing, False)
    aliased, sought = seek(amap, context, progress)
    # A heading at which half of the beams end in unknown space gives no information.
    is_finite = np.isfinite(aliased.area[sought])
    known_headings = np.maximum(is_finite.sum(axis=1), 1)
    share = np.where(is_finite, aliased.share[sought], 0.0).sum(axis=1) / known_headings
    share = share[is_finite.any(axis=1)]
    area = amap.judged.area(amap.judged.counted)
    if not share.size:
        return AliasingFindings(0, spacing, False)
    return AliasingFindings(
        poses,
        spacing,
        True,
        int(sought.sum()) * (poses // len(sought)),
        float(share.mean()),
        float((share >= 0.5).mean() * is_finite.any(axis=1).mean()) * area,
        find_aliased_pairs(context, aliased, letters),
    )


def _restrict_to_judged(amap: AmbiguityMap, lattice: Lattice) -> Lattice:
    """Restrict the free points of a lattice to the judged floor."""
    rows, columns = np.nonzero(lattice.free)
    x, y = lattice.x[columns], lattice.y[rows]
    counted = amap.judged.counted[_nearest_cells(amap, x, y)]
    free = np.zeros_like(lattice.free)
    free[rows[counted], columns[counted]] = True
    return dataclasses.replace(lattice, free=free)


def seek(
    amap: AmbiguityMap, context: LayerContext, progress: Progress = silent
) -> tuple[AliasedPoses, Bools]:
    """Return aliased poses, up to `COUNT` of each pose, and the cells where the search started.

    Those that the search finds are scanned where they are (`settle`), and what their arrangement
    leads to expect of neighbours is scanned too (`follow`). Those in the pose's own corridor or
    hall are left out.

    Args:
        amap: The map.
        context: Its context, or one with a wider lattice.
        progress: Called with the share done.
    """
    place = own_places(amap, *context.points)
    row, column = squares(*context.points, context.spacing)
    every = min(math.ceil(math.sqrt(pose_count(context) / MOST_POSES)), WIDEST)
    sought = (row % every == 0) & (column % every == 0)
    aliased = aliased_poses(context, count=COUNT, place=place, sought=sought, progress=progress)
    alike = follow(context, settle(context, aliased.poses))
    # Tracked poses may have entered the pose's own corridor or hall.
    at = np.nan_to_num(alike[..., :2])
    aliased_place = own_places(amap, at[..., 0], at[..., 1])
    alike[(aliased_place > 0) & (aliased_place == place[:, np.newaxis, np.newaxis])] = np.nan
    return dataclasses.replace(aliased, poses=alike), sought


def pose_count(context: LayerContext) -> int:
    """Count the distinct poses; one heading is enough for a scanner that looks all around."""
    return len(context.points[0]) * (1 if context.turns_in_place else len(context.headings))


def own_places(amap: AmbiguityMap, x: Floats, y: Floats) -> Ints32:
    """Label the corridor or hall of each point: int32 of the shape of x and y; 0 for none."""
    zone = amap.floor("zone", "mean").values
    labels, _ = ndimage.label((zone == CORRIDOR) | (zone == OPEN), np.ones((3, 3), dtype=int))
    return np.asarray(labels[_nearest_cells(amap, x, y)], dtype=np.int32)


def _nearest_cells(amap: AmbiguityMap, x: Floats, y: Floats) -> tuple[Ints, Ints]:
    """Return rows and columns of the cells nearest to points."""
    row, column = (
        np.clip(np.rint((at - grid[0]) / amap.spacing).astype(int), 0, len(grid) - 1)
        for at, grid in ((y, amap.dataset["y"].values), (x, amap.dataset["x"].values))
    )
    return row, column
