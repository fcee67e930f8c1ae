"""Halls with reflectors, lasers and scans for the tests of navigation by reflectors."""

from __future__ import annotations

import functools
import math

import numpy as np
import shapely
from numpy.typing import NDArray

import ambinav as an
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.layers.reflectors.targets import Targets
from ambinav.localization.information import BeamNoise, beam_noise
from ambinav.localization.reflector_detection import (
    COLUMNS,
    ReflectorBeams,
    detect_reflectors,
    reflector_beams,
)
from ambinav.localization.reflector_view import VIEW, ReflectorMap, expect
from ambinav.sensing import Intensity, RangeScanner, RangeSensor, read_intensity

Floats = NDArray[np.float64]
ArrayF = NDArray[np.float32]
CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
CLEAR = Intensity(wall=0.3, reflector=1.0, std=0.01)
GATE = -2.0 * math.log(1e-5)


def laser(
    beams: int = 720,
    mount: tuple[float, float, float] = (0.0, 0.0, 0.0),
    channel: Intensity = CHANNEL,
    aperture: float = 2 * math.pi,
    **fields: float,
) -> RangeScanner:
    """Return a laser of 25 m."""
    sensor = RangeSensor(
        **{"max_range": 25.0, "std": 0.01, "resolution": 0.001, **fields}, intensity=channel
    )
    return RangeScanner.planar(sensor, beams, aperture, mount)


def hall(*posts: tuple[float, float], strips: tuple[float, ...] = ()) -> Environment:
    """Return a hall with posts of 5 cm radius, and strips of 0.3 m on its lower wall."""
    lines = [[(x - 0.15, 0.0), (x + 0.15, 0.0)] for x in strips]
    bare = an.environment_from_shapes([shapely.box(0, 0, 20, 12)], reflectors=lines)
    if not posts:
        return bare
    return bare.edited(add=[Obstacle.post(x, y, 0.05, reflective=True) for x, y in posts])


def known(environment: Environment, scanner: RangeScanner, place: float = 0.0) -> ReflectorMap:
    targets = Targets.of(environment)
    noise = beam_noise(environment, scanner, 0.0)
    return ReflectorMap(targets.edges, targets.first, place, GATE, reflector_beams(scanner), noise)


@functools.cache
def tables(scanner: RangeScanner) -> tuple[ReflectorBeams, BeamNoise]:
    return reflector_beams(scanner), beam_noise(hall(), scanner, 0.0)


def detected(scanner: RangeScanner, ranges: ArrayF, intensities: ArrayF, head: int = 0) -> Floats:
    """Return the detections of a scan, (D, COLUMNS)."""
    (beams, noise), out = tables(scanner), np.empty((scanner.beams, COLUMNS))
    count = detect_reflectors(head, ranges, intensities, beams, noise, out)
    return out[:count]


def exact(environment: Environment, scanner: RangeScanner, pose: Floats) -> tuple[ArrayF, ArrayF]:
    """Return true ranges, and intensities that are nearly certain."""
    ranges = scanner.scan(environment, *pose)
    return ranges, read_intensity(
        scanner.with_intensity(CLEAR), environment, *pose, ranges, np.random.default_rng(0)
    )


def view_of(reflectors: ReflectorMap, pose: Floats, cov: Floats, k: int = 0) -> Floats | None:
    view = np.empty(VIEW)
    return view if expect(pose, cov, 0, k, reflectors, view) else None
