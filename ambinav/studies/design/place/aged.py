"""Gain of placed obstacles in buildings that differ from the map: robust placements."""

from __future__ import annotations

from typing import Final

import numpy as np
from pydantic import Field
from scipy.spatial import cKDTree

from ambinav.drive.ageing import with_aged_walls, with_moved_furniture
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.obstacle import Obstacle
from ambinav.reports.fields import Part
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.placed_part import Rounded
from ambinav.studies.design.region import Places

WALL_STD: Final = 0.03
"""Standard deviation of the displacement of walls, metres,"""
FURNITURE_STD: Final = 0.5
"""and of free-standing objects."""
WORST: Final = 10
"""Percentile of the gains that stands for an unlucky building."""
NEAREST: Final = 0.75
"""Places have the nearest pose of an aged building within this many spacings."""


class AgedPart(Part):
    """Bad floor that obstacles remove in aged buildings: walls displaced, furniture moved."""

    buildings: int
    wall_std_m: float = Field(description="standard deviation by which walls are displaced")
    furniture_std_m: float = Field(description="and by which free-standing objects are")
    before: Rounded = Field(description="bad floor without the obstacles, mean")
    gain: Rounded = Field(description="bad floor that they take away, mean")
    gain_low: Rounded = Field(description="its 10th percentile")


def gains_in_aged(
    effects: Effects,
    obstacles: tuple[Obstacle, ...],
    worlds: int,
    passage: float,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> AgedPart:
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
        mapped, aged = setting.lattice(effects.environment)[0], setting.lattice(world)[0]
        aged_effects = Effects(world, setting, _same_places(effects.places, mapped, aged))
        before[k] = aged_effects.badness.bad
        gain[k] = aged_effects.tried(obstacles).gain.bad
        progress((k + 1) / worlds)
    return AgedPart(
        buildings=worlds,
        wall_std_m=WALL_STD,
        furniture_std_m=FURNITURE_STD,
        before=before.mean(),
        gain=gain.mean(),
        gain_low=np.percentile(gain, WORST),
    )


def _same_places(places: Places, mapped: Lattice, aged: Lattice) -> Places:
    """Return the places on the lattice of an aged building; those without a pose near are out."""
    at = np.column_stack(mapped.points)[places.point]
    away, point = cKDTree(np.column_stack(aged.points)).query(at)
    near = away <= NEAREST * mapped.spacing
    return Places.merged(point[near], places.heading[near], places.weight[near])
