"""Buildings that repeat, and where each of their poses has its twins."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import shapely
from numpy.typing import NDArray

import ambinav as an

Complex = NDArray[np.complex128]
Twin = tuple[Callable[[Complex], Complex], float]
"""Where a pose x + i y has a twin, and how much the robot is turned there."""
PERIOD = 4.0


def turned(part: shapely.Polygon, fold: int) -> an.Environment:
    parts = [shapely.affinity.rotate(part, 360 / fold * i, origin=(0, 0)) for i in range(fold)]
    return an.environment_from_shapes([shapely.union_all(parts)])


def crossing() -> an.Environment:
    """Four equal corridors, each with the same niche."""
    return turned(shapely.union_all([shapely.box(0, -0.6, 4, 0.6), shapely.box(3, 0, 3.5, 1.1)]), 4)


def hexagon() -> an.Environment:
    """A hexagonal hall with six equal arms, each with the same niche."""
    corners = [2.5 * np.exp(1j * math.pi * (i + 0.5) / 3) for i in range(6)]
    hall = shapely.Polygon([(corner.real, corner.imag) for corner in corners])
    arm = [shapely.box(0, -0.6, 6, 0.6), shapely.box(5, 0, 5.5, 1.1)]
    return turned(shapely.union_all([hall, *arm]), 6)


def rooms(count: int) -> an.Environment:
    """Equal rooms, each with its door to a corridor whose ends nobody sees from them."""
    room = shapely.Polygon([(0.2, 1.8), (3.8, 1.8), (3.8, 4.6), (1.2, 5.2)])
    parts = [shapely.box(-6, 0, PERIOD * count + 6, 1.5)]
    for i in range(count):
        for part in (room, shapely.box(1.5, 1.4, 2.4, 1.9)):
            parts.append(shapely.affinity.translate(part, PERIOD * i))
    return an.environment_from_shapes([shapely.union_all(parts)])


def turns(fold: int) -> list[Twin]:
    angles = [math.tau * i / fold for i in range(1, fold)]
    return [(lambda p, a=a: p * np.exp(1j * a), a) for a in angles]


def shifts(count: int) -> list[Twin]:
    steps = [step for step in range(1 - count, count) if step != 0]
    return [(lambda p, s=step: p + PERIOD * s, 0.0) for step in steps]


def have(
    found: NDArray[np.float64], p: Complex, twin: Twin, within: float = 0.01
) -> NDArray[np.bool_]:
    """Whether poses p have this twin among what was found, shape (P, 1, count, 4)."""
    move, turn = twin
    entries = found[:, 0]
    off = np.abs(entries[..., 0] + 1j * entries[..., 1] - move(p)[:, np.newaxis])
    bend = np.abs(np.angle(np.exp(1j * (entries[..., 2] - turn))))
    return ((off < within) & (bend < 0.01) & (entries[..., 3] > 0.9)).any(axis=1)
