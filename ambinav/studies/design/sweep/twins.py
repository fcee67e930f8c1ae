"""Settings that are the same scanner: the same beams, however numbered or turned."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ambinav.ambiguity.model import independent_tau, thin
from ambinav.ambiguity.panorama import View, view_beams
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor


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
