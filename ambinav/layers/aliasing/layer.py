"""Aliasing: the share of the rest of the map that gives the same scan, and where it is.

Own definition, built on the same indistinguishability I(p, q) of scans as the map itself
(docs/model.md; Ruiz-Mayor, Crespo and Trivino 2017 for that of ranges). For a pose p let q be any
pose of the lattice, the robot turned by any angle:

    far(p)      = sum of I(p, q) over the poses q farther than R from p, and all turns
    near(p)     = the same over the poses q within R, p itself included
    aliasing(p) = far / (near + far)

`aliasing` is a share: of the poses whose scans agree with p's by 1 in 100 or more, each weighted
by how well it agrees, those that are farther than R. It is no probability of where the robot is:
I compares two noisy scans, not a scan with what a pose is expected to give, its evidence is
divided by tau and capped, and pairs that agree less are left out. (Each I represents the integral
over q's cell, so the sums are integrals over poses.) In a building that repeats n times it is
1 - 1/n, however sharply a scan tells the position, up to what the linear model of a cell loses at
twins between lattice points (docs/layers.md).
`aliasing_area` is the literal answer, far(p) times the area of a cell: how many square metres
beyond R give the same scan. It is small where scans are sharp, for then an aliased pose is a point.

* **Turns.** A scanner that looks all around (`RangeScanner.turns_in_place`) is turned in
  the n steps that give the same beams again, its scan shifted; each represents the turns half a
  step to both sides, as a cell represents its poses. Other scanners are compared at the map's
  headings, each within its `sigma_theta`; an aliased pose at a heading between them is missed.
* **Within a cell** I is the two-step Laplace integral of `kernel.compare`. All of it is
  needed: without the offset, twin rooms that are no multiple of the spacing apart would not be
  twins; with each beam moved on its own instead of all together, every fifth pair of poses in an
  office would be alike.
* **Least likeness.** A pair counts if its scans, at the best offset, are alike to at least 1 in
  100, the offset's own improbability included (Phi <= ln 100, see `aliasing.signature`); less is
  0. Otherwise the many poses that are very unlike would weigh as much as the few that are alike.
* **Unknown space.** A pose with half of its beams or more ending there (the map's `unexplored`)
  takes no part: as an aliased pose it would be like everything. Its own `aliasing` is 1, for
  nothing is known there. Nor does a pose that is impossible (`standing`), which has no value.

Aliased poses are listed by likeness, exp(- capped evidence / tau) at the best offset, 1 for the
same scan, each farther than R from p and from those before it. The search is exact; what makes it
fast is in `aliasing.signature`, with proofs.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.layers.aliasing.kernel import COMPARED, orbit_rows, search
from ambinav.layers.aliasing.scans import Scans
from ambinav.layers.aliasing.signature import Signatures
from ambinav.layers.aliasing.tree import Tree
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Bools, Floats, Floats32, Indices, Ints, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent

LEAST_LIKENESS = 0.01
# Poses searched for in one call of the kernel.
BATCH = 1024
SIDE = 2
"""Lattice cells along a bundle's side; wider ones share more and leave out less."""


@dataclass(frozen=True, eq=False)
class AliasedPoses:
    """Poses aliased with each of N poses: P free cells, times K headings where these matter.

    Attributes:
        share: `aliasing`, shape (P, K); NaN at impossible poses.
        area: `aliasing_area`, square metres, shape (P, K); NaN at these and in unexplored cells.
        poses: Up to `count` aliased poses, float64, shape (P, K, count, 4): x and y (metres), turn
            from the pose's heading to that of the aliased pose (radians, in (-pi, pi]), likeness.
            NaN where there are no more.
        left: How many pairs of poses and turns each step left: signature and count of the bundle,
            count, gap, and, of these compared in full, the alike ones; int64, shape (4,).
    """

    share: Floats
    area: Floats
    poses: Floats
    left: Ints

    @property
    def compared(self) -> int:
        """Number of pairs of scans that were compared in full."""
        return int(self.left[COMPARED])


def aliased_poses(
    context: LayerContext,
    count: int = 1,
    *,
    least: float = LEAST_LIKENESS,
    place: Ints32 | None = None,
    sought: Bools | None = None,
    progress: Progress = silent,
) -> AliasedPoses:
    """Find the poses aliased with each pose of a map.

    Args:
        context: The map's context.
        count: How many aliased poses to list of each pose, at least 1.
        least: Likeness from which a pair counts, in (0, 1).
        place: Number of the place that each cell lies in, shape (P,); aliased poses in the pose's
            own place are not listed where the number is above 0. They count all the same.
        sought: Cells whose aliased poses are sought, on all the map, shape (P,); None: all. The
            share and the area of others are NaN, and nothing is listed.
        progress: Called with the share done.

    Raises:
        InputError: `least` is not between 0 and 1.
    """
    if not 0.0 < least < 1.0:
        raise InputError(f"least is {least}; give a likeness between 0 and 1, such as 0.01.")
    scans = Scans.of(context)
    threshold = -math.log(least)
    poses, cells = len(scans.x), len(context.points[0])
    mass = np.zeros((poses, 2))
    aliased = np.full((poses, count, 4), np.nan)
    explored = np.flatnonzero(scans.explored)
    step_counts = np.zeros(4, dtype=np.int64)
    if explored.size:
        signatures = Signatures.of(scans, threshold)
        tree = Tree.over(signatures, explored, scans.turns)
        places = np.zeros(cells, dtype=np.int32) if place is None else place.astype(np.int32)
        rows = orbit_rows(scans)
        bundles = _bundles(
            scans, explored if sought is None else explored[sought[scans.cell[explored]]]
        )
        parts = -(-sum(map(len, bundles)) // BATCH)
        for part in range(parts):
            # Far apart, so that hard poses are shared among the threads.
            chosen = bundles[part::parts]
            if not chosen:
                continue
            poses_of = np.concatenate(chosen).astype(np.int32)
            begins = np.cumsum([0, *(len(bundle) for bundle in chosen)])
            mass[poses_of], aliased[poses_of], steps = search(
                poses_of, begins, scans, rows, signatures, tree, places[scans.cell], context.radius,
                threshold, count,
            )  # fmt: skip
            step_counts += steps.sum(axis=0)
            progress((part + 1) / parts)
    total = mass.sum(axis=1)
    share = np.divide(mass[:, 1], total, out=np.ones(poses), where=total > 0.0)
    share[~scans.possible] = np.nan
    area = np.where(scans.explored, mass[:, 1] * context.spacing**2, np.nan)
    if sought is not None:
        share[~sought[scans.cell]] = area[~sought[scans.cell]] = np.nan
    aliased[:, :, 2] = math.pi - np.mod(math.pi - aliased[:, :, 2], 2.0 * math.pi)
    # Where the scanner looks all around, one heading stands for all.
    shape = (cells, poses // cells)
    wide = (cells, len(context.headings))
    return AliasedPoses(
        np.broadcast_to(share.reshape(shape), wide),
        np.broadcast_to(area.reshape(shape), wide),
        np.broadcast_to(aliased.reshape(*shape, count, 4), (*wide, count, 4)),
        step_counts,
    )


def _bundles(scans: Scans, explored: Indices) -> list[Indices]:
    """Group poses of one heading in the same square, whose scans are nearly the same."""
    x, y = scans.x[explored], scans.y[explored]
    square = np.column_stack([scans.heading[explored], *squares(x, y, scans.spacing)])
    _, of = np.unique(square, axis=0, return_inverse=True)
    order = np.argsort(of.ravel(), kind="stable")
    return np.split(explored[order], np.flatnonzero(np.diff(of.ravel()[order])) + 1)


def squares(x: Floats, y: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Return row and column of the square of `SIDE` x `SIDE` cells that contains each point."""
    side = SIDE * spacing
    return np.floor(y / side + 1e-6), np.floor(x / side + 1e-6)


def compute(context: LayerContext, least: float = LEAST_LIKENESS) -> dict[str, Floats32]:
    """Compute the layer and its companions; `least` as in `aliased_poses`."""
    alike = aliased_poses(context, least=least)
    best = alike.poses[:, :, 0]
    x, y = context.points
    distance = np.hypot(best[..., 0] - x[:, np.newaxis], best[..., 1] - y[:, np.newaxis])
    return {
        "aliasing": context.spread(alike.share),
        "aliasing_area": context.spread(alike.area),
        "aliasing_x": context.spread(best[..., 0]),
        "aliasing_y": context.spread(best[..., 1]),
        "aliasing_turn": context.spread(best[..., 2]),
        "aliasing_likeness": context.spread(best[..., 3]),
        "aliasing_distance": context.spread(distance),
    }


LAYER = Layer(
    name="aliasing",
    title="share of the poses with the same scan that are elsewhere",
    unit="1",
    source="own, from the indistinguishability of scans: docs/layers.md",
    worse="high",
    compute=compute,
    compares_cells=True,
    in_space=True,
    companions={
        "aliasing_area": ("floor farther than R that gives the same scan", "m^2"),
        "aliasing_x": ("x of the most alike pose farther than R", "m"),
        "aliasing_y": ("y of the most alike pose farther than R", "m"),
        "aliasing_turn": ("turn from the heading to that of the most alike pose", "rad"),
        "aliasing_likeness": ("likeness of the most alike pose's scan", "1"),
        "aliasing_distance": ("distance to the most alike pose farther than R", "m"),
    },
    slow=True,
)
