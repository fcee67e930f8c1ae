"""Best direction of view for a scanner at each point.

The paper's optimum orientation (Ruiz-Mayor, Crespo and Trivino 2017), as a layer. The robot is
turned as a whole, with the scanner as it is mounted on it, to directions evenly around; each is
computed as `build_map` computes a heading, but only the best is kept. It is a direction in the map:
a robot that keeps its heading theta gets it by a yaw of the direction less theta, one without a
turntable by turning itself.
"""

from __future__ import annotations

import math

import numpy as np

from ambinav.ambiguity.feasible_poses import standing
from ambinav.ambiguity.panorama import View, view_radii
from ambinav.config import as_count
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Floats32
from ambinav.sensing.scanner import RangeScanner

YAWS = 24
# Beams whose directions cancel out to less of a beam each have no axis.
NO_AXIS = 1e-6


def best_yaw(context: LayerContext, *, yaws: int = YAWS) -> dict[str, Floats32]:
    """Compute the level at the scanner's best direction, that direction, and the gain.

    Args:
        context: What the map was made of.
        yaws: Directions that are tried, evenly around.

    Returns:
        best_yaw (1): the lowest level; best_yaw_angle (radians, [0, 2 pi), map frame): where the
        scanner's axis then points; best_yaw_gain (1): mean level over the directions at which the
        robot can stand, less the lowest. All of shape (ny, nx).

    Raises:
        InputError: there is no such number of directions.
    """
    yaws = as_count(yaws, "yaws")
    turns = 2.0 * math.pi * np.arange(yaws) / yaws
    possible = standing(context.lattice, context.full_scanner, turns, context.model.robot_radius)
    views = [
        View(context.scanner, float(turn), context.model.tau, i) for i, turn in enumerate(turns)
    ]
    points = len(possible)
    least, best = np.full(points, np.inf), np.zeros(points, dtype=np.intp)
    total, count = np.zeros(points), np.zeros(points)
    pieces = view_radii(context.lattice, possible, np.arange(points), views, context.model)
    for numbers, at, major, minor in pieces:
        level = (major + minor) / 2
        is_finite = np.isfinite(level)
        for i in numbers:
            # Among equal values choose the first, independent of their order.
            better = (level < least[at]) | ((level == least[at]) & (i < best[at]))
            better &= is_finite
            least[at[better]], best[at[better]] = level[better], i
            total[at[is_finite]] += level[is_finite]
            count[at[is_finite]] += 1
    nowhere = count == 0
    lowest = np.where(nowhere, np.nan, least)
    angle = (turns[best] + axis(context.full_scanner)) % (2.0 * math.pi)
    # Single precision would make a whole turn of what is hardly less.
    angle = np.where(angle.astype(np.float32) >= 2.0 * math.pi, 0.0, angle)
    return {
        "best_yaw": context.spread(lowest),
        "best_yaw_angle": context.spread(np.where(nowhere, np.nan, angle)),
        "best_yaw_gain": context.spread(total / np.maximum(count, 1) - lowest),
    }


def axis(scanner: RangeScanner) -> float:
    """Return the mean direction of the beams in the robot's frame, radians.

    0, the robot's front, where they cancel out.
    """
    mean = complex(np.exp(1j * scanner.mounts[:, 2]).mean())
    return math.atan2(mean.imag, mean.real) if abs(mean) > NO_AXIS else 0.0


def why_not(scanner: RangeScanner) -> str | None:
    """Return why the layer does not exist for a scanner; None if it does."""
    if scanner.looks_all_around:
        return "it looks all around, so that no direction is better than another."
    return None


LAYER = Layer(
    name="best_yaw",
    title="level with the scanner turned the best way",
    unit="1",
    source="Ruiz-Mayor, Crespo and Trivino 2017 (optimum orientation); own level: docs/layers.md",
    worse="high",
    compute=best_yaw,
    compares_cells=True,
    in_space=True,
    why_not=why_not,
    companions={
        "best_yaw_angle": ("best direction of the scanner's axis", "rad"),
        "best_yaw_gain": ("mean level over directions less that of the best", "1"),
    },
    high_is_good=("best_yaw_gain",),
    slow=True,
)
