"""Extrusion of a plan to a building of one height, for rays in space."""

from __future__ import annotations

import numpy as np

from ambinav.casting.prisms.prisms import Prisms
from ambinav.config import as_positive
from ambinav.geometry.environment import Environment


def extruded(environment: Environment, height: float, floor: float = 0.0) -> Prisms:
    """Turn every segment of a plan into a wall of one height, between a floor and a ceiling.

    Walls are numbered as the plan's segments are, and keep their kinds. A level ray goes as far as
    in the plan, at every height in between, and is nan where it starts beside the free space.

    Args:
        environment: The plan.
        height: Height of the walls, metres.
        floor: z of the floor, metres.

    Raises:
        InputError: the height is no positive number, or the floor no finite one.
    """
    height = as_positive(height, "height", "metres")
    xy = environment.segments.xy
    return Prisms(
        xy,
        np.tile((floor, floor + height), (len(xy), 1)),
        environment.segments.kind,
        floor=floor,
        ceiling=floor + height,
        free=environment.free,
    )
