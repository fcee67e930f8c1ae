"""Views of several scanners at each heading, computed side by side, and which are the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambinav.ambiguity.feasible_poses import AT_CENTRE, can_stand
from ambinav.ambiguity.model import independent_tau, thin
from ambinav.ambiguity.panorama import View, view_beams
from ambinav.geometry.lattice import Lattice
from ambinav.runtime.array_types import Bools, Floats, Indices, Ints
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor


@dataclass(frozen=True, eq=False)
class ScannerView:
    """The view of a scanner at one heading, or at several headings with the same view."""

    scanner: int
    headings: Indices
    view: View


def scanner_views(
    lattice: Lattice,
    scanners: Sequence[RangeScanner],
    order: Sequence[int] | None,
    headings: Floats,
) -> tuple[list[ScannerView], Bools]:
    """Return the views of all scanners, and where the robot can stand with each.

    The second is of shape (N, S): `View.standing` names a column.
    """
    x, y = lattice.points
    views: list[ScannerView] = []
    column: dict[tuple[bytes, float], int] = {}
    possible: list[Bools] = []
    for number in range(len(scanners)) if order is None else order:
        scanner = scanners[number]
        around = scanner.looks_all_around
        mounted = scanner.centred if around else scanner
        thinned = thin(mounted)
        tau = independent_tau(thinned)
        # With their heights, which decide in space.
        sensors = np.column_stack([mounted.mounts[:, :2], mounted.upright[:, 0]])
        origins = np.unique(np.round(sensors, 9), axis=0)
        off_centre = bool(np.hypot(*origins[:, :2].T).max() > AT_CENTRE)
        for h, theta in enumerate([0.0] if around else headings.tolist()):
            # Sensors in the robot's centre are at its position at every heading.
            key = origins.tobytes(), theta if off_centre else 0.0
            if key not in column:
                column[key] = len(possible)
                stands = can_stand(lattice.environment, mounted, x, y, theta)
                possible.append(stands)
            at = np.arange(len(headings)) if around else np.array([h])
            views.append(ScannerView(number, at, View(thinned, theta, tau, column[key])))
    return views, np.stack(possible, axis=1)


def first_twins(scanners: Sequence[RangeScanner]) -> tuple[int, ...]:
    """Return the index of the first scanner with the same beams, for each; it may be its own.

    What counts are the beams that take part in a map (60 a turn), from where they are cast. Two
    scanners whose mounts are those of each other after a turn about which the scanner is symmetric
    have the same ones.
    """
    sensors: dict[RangeSensor, int] = {}
    first: dict[object, int] = {}
    firsts = []
    for number, scanner in enumerate(scanners):
        mounted = scanner.centred if scanner.looks_all_around else scanner
        beams = thin(mounted)
        tau = independent_tau(beams)
        _, keys = view_beams(View(beams, 0.0, tau), sensors)
        # The mounts of unused beams count too, since they must not be inside a wall.
        origins = np.unique(np.round(mounted.mounts[:, :2], 9) + 0.0, axis=0)
        key = keys[np.lexsort(keys.T)].tobytes(), round(tau, 9), origins.tobytes()
        firsts.append(first.setdefault((scanner.looks_all_around, *key), number))
    return tuple(firsts)


def mask_of(numbers: Ints, count: int) -> Bools:
    """Return a mask, shape (count,), that is true at the given indices."""
    mask = np.zeros(count, dtype=np.bool_)
    mask[numbers] = True
    return mask
