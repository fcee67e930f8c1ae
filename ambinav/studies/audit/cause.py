"""Causes of a place's ambiguity: walls along which the scan stays the same, or none in range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.runtime.array_types import Bools
from ambinav.sensing.sight import SAME_DEPTH, SAME_DIRECTION, Sight

FEW: Final = 0.1
"""Share of the beams up to which those that end across a weak direction are called few."""
LEAST: Final = 0.02
"""Share of the beams, two at least, that must end on a wall that is named."""


@dataclass(frozen=True)
class SeenWall:
    """The part of a wall that a scanner sees.

    Attributes:
        start: One end: x and y, metres, map frame.
        end: The other end.
        distance: From the robot to its line, metres.
    """

    start: tuple[float, float]
    end: tuple[float, float]
    distance: float

    @property
    def text(self) -> str:
        """Its ends in words."""
        return "from ({:.1f}, {:.1f}) to ({:.1f}, {:.1f})".format(*self.start, *self.end)


@dataclass(frozen=True)
class Cause:
    """Cause of a place's ambiguity.

    Attributes:
        walls: Walls along the weak direction, at most one on either side; none where no direction
            is weaker than the others.
        sentence: The cause in words.
    """

    walls: tuple[SeenWall, ...]
    sentence: str


def cause_of(sight: Sight, direction: float | None) -> Cause:
    """Return why a place is ambiguous.

    Args:
        sight: The scan there.
        direction: Weak direction, radians; None: no direction is weaker than the others.
    """
    at_wall = np.isfinite(sight.distance) & ~sight.frontier
    reach = f"{sight.max_range.max():g} m"
    if not at_wall.any():
        ended = int(sight.frontier.sum())
        unknown = f"; {ended} of {sight.beams} beams end at unknown space" if ended else ""
        return Cause((), f"No beam meets a wall within {reach}{unknown}.")
    along, walls = np.zeros_like(at_wall), tuple[SeenWall, ...]()
    if direction is not None:
        turn = np.abs((sight.along - direction + math.pi / 2) % math.pi - math.pi / 2)
        along = at_wall & (turn < SAME_DIRECTION)
        walls = _walls_along(sight, along, direction)
    if not walls:
        nearest = f"the nearest wall is {sight.distance[at_wall].min():.1f} m away"
        return Cause((), f"{at_wall.sum()} of {sight.beams} beams reach a wall; {nearest}.")
    if len(walls) == 2:
        separation = sum(wall.distance for wall in walls)
        text = f"Two walls run along the weak direction, {separation:.1f} m apart"
    else:
        text = f"One wall runs along the weak direction, {walls[0].distance:.1f} m away"
    where = " and ".join(wall.text for wall in walls)
    across = int((at_wall & ~along).sum())
    if not across:
        across_text = f"no beam meets another wall within {reach}"
    else:
        only = "only " if across <= FEW * sight.beams else ""
        across_text = f"{only}{across} of {sight.beams} beams end on another wall"
    return Cause(walls, f"{text}, {where} m; {across_text}.")


def _walls_along(sight: Sight, along: Bools, direction: float) -> tuple[SeenWall, ...]:
    """Return, on either side, the wall along a direction on which most beams end."""
    ahead = np.array([math.cos(direction), math.sin(direction)])
    left = np.array([-ahead[1], ahead[0]])
    position = np.array([sight.x, sight.y])
    hit = sight.hit[along] - position
    offset, place = hit @ left, hit @ ahead
    walls = []
    for side in (offset > 0.0, offset <= 0.0):
        if not side.any():
            continue
        near = np.abs(offset[side, None] - offset[side]) < SAME_DEPTH
        mine = np.flatnonzero(side)[near[near.sum(axis=1).argmax()]]
        if len(mine) < max(2.0, LEAST * sight.beams):
            continue
        depth = float(np.median(offset[mine]))
        first, last = (
            tuple((position + depth * left + at * ahead).tolist())
            for at in (place[mine].min(), place[mine].max())
        )
        walls.append(SeenWall(first, last, abs(depth)))
    return tuple(walls)
