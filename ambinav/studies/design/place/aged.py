"""Gain of placed obstacles in buildings that differ from the map: robust placements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from ambinav.drive.ageing import with_aged_walls, with_moved_furniture
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.obstacle import Obstacle
from ambinav.runtime.array_types import Floats
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.region import Places

WALL_STD: Final = 0.03
"""Standard deviation of the displacement of walls, metres,"""
FURNITURE_STD: Final = 0.5
"""and of free-standing objects."""
WORST: Final = 10
"""Percentile of the gains that stands for an unlucky building."""
NEAREST: Final = 0.75
"""Places have the nearest pose of an aged building within this many spacings."""


@dataclass(frozen=True, eq=False)
class AgedGains:
    """Bad floor of W aged buildings.

    Attributes:
        before: Without the obstacles, square metres or metres of routes, shape (W,).
        gain: What they remove, shape (W,).
    """

    before: Floats
    gain: Floats


def gains_in_aged(
    effects: Effects,
    obstacles: tuple[Obstacle, ...],
    worlds: int,
    passage: float,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> AgedGains:
    """Compute what obstacles remove in aged buildings: walls displaced, furniture moved.

    The obstacles stand where they stand; the floor that counts stays as well, apart from where no
    robot can be any more.

    Args:
        effects: The building without the obstacles.
        obstacles: The obstacles.
        worlds: Number W of aged buildings.
        passage: Metres that moved furniture leaves free beside it.
        rng: Draws the buildings.
        progress: Called with the share done.
    """
    before, gain = np.empty(worlds), np.empty(worlds)
    for k in range(worlds):
        world = with_moved_furniture(effects.environment, FURNITURE_STD, rng, passage)
        world = with_aged_walls(world, WALL_STD, rng)
        setting = effects.setting
        known, aged = setting.lattice(effects.environment)[0], setting.lattice(world)[0]
        there = Effects(world, setting, _same_places(effects.places, known, aged))
        before[k] = there.badness.bad
        gain[k] = there.tried(obstacles).gain.bad
        progress((k + 1) / worlds)
    return AgedGains(before, gain)


def _same_places(places: Places, known: Lattice, aged: Lattice) -> Places:
    """Return the places on the lattice of an aged building; those without a pose near are out."""
    at = np.column_stack(known.points)[places.point]
    away, point = cKDTree(np.column_stack(aged.points)).query(at)
    kept = away <= NEAREST * known.spacing
    return Places.merged(point[kept], places.heading[kept], places.weight[kept])
