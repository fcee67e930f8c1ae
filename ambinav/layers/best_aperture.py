"""Smallest aperture at each point that does as well as one that looks all around.

The paper's optimum aperture (Ruiz-Mayor, Crespo and Trivino 2017), as a layer. The fan of the
scanner is made narrower and wider, with the same angle between its beams, and turned the best way;
its level is held against that of the same sensor all around.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ambinav.ambiguity.feasible_poses import standing
from ambinav.ambiguity.model import independent_tau, thin
from ambinav.ambiguity.panorama import View, view_radii
from ambinav.config import as_count, as_nonnegative, as_number
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Bools, Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Part, Planar
from ambinav.sensing.mounting import TURN
from ambinav.sensing.scanner import RangeScanner

LOSS = 0.05
STEP = math.radians(30.0)
YAWS = 12
# Levels that differ by less count as equal.
SAME = 1e-6


def best_aperture(
    context: LayerContext, *, loss: float = LOSS, step: float = STEP, yaws: int = YAWS
) -> dict[str, Floats32]:
    """Find the smallest aperture whose level exceeds the full circle's by at most `loss`.

    Args:
        context: What the map was made of.
        loss: Accepted loss of level, at least 0.
        step: Radians: apertures are tried from one step on, by steps, and last the whole turn.
        yaws: Directions that each is turned to, evenly around.

    Returns:
        best_aperture (degrees, for it is an amount and no direction), and best_aperture_around (1),
        the level all around. Of shape (ny, nx).

    Raises:
        InputError: a number is out of its range.
    """
    loss, step, yaws = as_nonnegative(loss, "loss"), as_number(step, "step"), as_count(yaws, "yaws")
    if not math.radians(1.0) <= step <= TURN:
        raise InputError(f"step is {step}; give radians from 0.0175 (1 degree) to 2 pi.")
    apertures = [*(step * i for i in range(1, math.ceil(TURN / step - 1e-9))), TURN]
    turns = TURN * np.arange(yaws) / yaws
    scanner, lattice, model = context.full_scanner, context.lattice, context.model
    # With a tau that the user chose, scale the usual tau by the same factor.
    scale = model.tau / independent_tau(context.scanner)
    views: list[View] = []
    aperture_of: list[int] = []
    possible: list[Bools] = []
    stands = standing(lattice, scanner, turns, model.robot_radius)
    for i, aperture in enumerate(apertures):
        narrowed = with_aperture(scanner, aperture)
        around = narrowed.looks_all_around
        if around:
            narrowed = narrowed.centred
            possible.append(standing(lattice, narrowed, np.zeros(1), model.robot_radius))
        thinned = thin(narrowed)
        tau = max(scale * independent_tau(thinned), 1.0)
        for h, turn in enumerate([0.0] if around else turns.tolist()):
            views.append(View(thinned, turn, tau, yaws + len(possible) - 1 if around else h))
            aperture_of.append(i)
    least = np.full((len(apertures), len(stands)), np.inf, dtype=np.float32)
    columns = np.hstack([stands, *possible])
    for numbers, at, major, minor in view_radii(
        lattice, columns, np.arange(len(stands)), views, model
    ):
        level = (major + minor) / 2
        for i in {aperture_of[number] for number in numbers}:
            least[i, at] = np.fmin(least[i, at], level)
    around_level = np.where(np.isfinite(least[-1]), least[-1], np.nan)
    is_sufficient = least <= around_level + loss + SAME
    smallest = np.degrees(np.array(apertures))[is_sufficient.argmax(axis=0)]
    return {
        "best_aperture": context.spread(np.where(np.isnan(around_level), np.nan, smallest)),
        "best_aperture_around": context.spread(around_level),
    }


def with_aperture(scanner: RangeScanner, aperture: float) -> RangeScanner:
    """Return a scanner of one planar part with another aperture."""
    (part,) = scanner.parts
    layout = part.layout
    if not isinstance(layout, Planar):
        raise TypeError(f"{scanner.name!r} is not a fan; see why_not")
    return replace(scanner, parts=(Part(part.sensor, layout.with_aperture(aperture)),))


def why_not(scanner: RangeScanner) -> str | None:
    """Return why the layer does not exist for a scanner; None if it does."""
    layout = scanner.parts[0].layout
    if len(scanner.parts) > 1 or not isinstance(layout, Planar) or layout.beams < 2:
        return "only a single planar fan of two beams or more can be widened."
    return None


LAYER = Layer(
    name="best_aperture",
    title="smallest aperture that does as well as all around",
    unit="deg",
    source="Ruiz-Mayor, Crespo and Trivino 2017 (optimum aperture); own level: docs/layers.md",
    worse="high",
    compute=best_aperture,
    compares_cells=True,
    why_not=why_not,
    companions={"best_aperture_around": ("level of the same sensor looking all around", "1")},
    slow=True,
    in_space=True,
)
