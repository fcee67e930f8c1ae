"""A corridor with boxes along its walls, and what spoils its map: people, and boxes that moved."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.sensing.scanner import RangeScanner
from tests.localization import worlds

Floats = NDArray[np.float64]

LENGTH, WIDTH, HERE = 40.0, 2.4, 1.2
MOVED = 0.5
"""Deviation of where a box was moved to along its wall, metres."""
PERSON = 0.2
"""Radius of a person, metres."""
SPOILT = ("clean", "people", "aged")


class Drive(NamedTuple):
    """A drive through the middle of the corridor: map, scanner, S true poses, (S, R, B) scans."""

    environment: Environment
    scanner: RangeScanner
    truth: Floats
    scans: NDArray[np.float32]


def drive(spoilt: str, seed: int, steps: int = 112, runs: int = 8) -> Drive:
    """A drive of 0.25 m steps; the runs see the same people and differ in the sensor's noise."""
    rng, scanner = np.random.default_rng(seed), worlds.laser(beams=90, reach=8.0)
    boxes = np.column_stack(
        [rng.uniform(1.0, LENGTH - 1.6, 14), rng.integers(0, 2, 14), rng.uniform(0.4, 1.0, 14),
         rng.uniform(0.15, 0.4, 14)]
    )  # fmt: skip
    truth = np.zeros((steps, 3))
    truth[:, 0], truth[:, 1] = 4.0 + 0.25 * np.arange(steps), HERE
    world = building = corridor(boxes)
    if spoilt == "aged":
        boxes[:, 0] += rng.normal(0.0, MOVED, 14)
        boxes[:, 0] = np.clip(boxes[:, 0], 0.1, LENGTH - 1.5)
        world = corridor(boxes)
    ranges = np.asarray(scanner.scan(world, *truth.T), dtype=np.float64)
    if spoilt == "people":
        people = np.column_stack([rng.uniform(-2.5, 3.0, 8), rng.uniform(-0.75, 0.75, 8)])
        for k in range(steps):
            people += rng.normal(0.0, 0.03, people.shape)
            near = people[np.hypot(*people.T) > 0.45]
            ranges[k] = np.minimum(ranges[k], to_discs(near, scanner.mounts[:, 2]))
    scans = scanner.capture(np.repeat(ranges[:, np.newaxis], runs, axis=1), rng)
    return Drive(building, scanner, truth, scans)


def corridor(boxes: Floats) -> Environment:
    """Boxes (n, 4): x, which wall (0 or 1), width, depth."""
    shapes = [
        shapely.box(x, 0.0 if side == 0 else WIDTH - deep, x + wide, deep if side == 0 else WIDTH)
        for x, side, wide, deep in boxes
    ]
    return environment_from_shapes([shapely.box(0.0, 0.0, LENGTH, WIDTH)], shapes, name="corridor")


def to_discs(centres: Floats, angles: Floats) -> Floats:
    """Distance from (0, 0) to the nearest person in each direction; inf if there is none."""
    along = centres @ np.array([np.cos(angles), np.sin(angles)])
    half = PERSON**2 - ((centres**2).sum(axis=1)[:, np.newaxis] - along**2)
    hit = (along > 0.0) & (half > 0.0)
    distance = np.where(hit, along - np.sqrt(np.maximum(half, 0.0)), np.inf)
    return np.asarray(distance.min(axis=0, initial=np.inf))
