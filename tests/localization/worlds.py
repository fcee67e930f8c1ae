"""Rooms whose localization is known, and robots that drive through them."""

from __future__ import annotations

import math

import numpy as np
import shapely
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import Segments
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

Floats = NDArray[np.float64]

# A room without any symmetry: an L with a notch, counter-clockwise.
L_ROOM = (
    (0.0, 0.0), (9.0, 0.0), (9.0, 4.0), (5.0, 4.0), (5.0, 5.0), (4.0, 5.0), (4.0, 7.0),
    (1.5, 7.0), (1.5, 6.2), (0.0, 6.2),
)  # fmt: skip


def walls(ring: tuple[tuple[float, float], ...], frontiers: tuple[int, ...] = ()) -> Environment:
    """A room with these corners; the sides with these numbers are frontiers."""
    points = np.array(ring)
    xy = np.hstack([points, np.roll(points, -1, axis=0)])
    kind = np.zeros(len(xy), dtype=np.uint8)
    kind[list(frontiers)] = 1
    return Environment(Segments(xy, kind), shapely.Polygon(ring), name="room")


def room() -> Environment:
    return walls(L_ROOM)


def box(width: float, height: float, frontiers: tuple[int, ...] = ()) -> Environment:
    """A rectangle from (0, 0); its sides are numbered from the lower one counter-clockwise."""
    return walls(((0.0, 0.0), (width, 0.0), (width, height), (0.0, height)), frontiers)


def laser(beams: int = 60, reach: float = 12.0, std: float = 0.03) -> RangeScanner:
    sensor = RangeSensor(max_range=reach, std=std, resolution=0.001, random_share=0.0)
    return RangeScanner.planar(sensor=sensor, beams=beams, aperture=2 * math.pi)


def sonar_ring(reach: float = 5.0) -> RangeScanner:
    """Sixteen cones of 25 degrees that stand 0.2 m from the centre and know specular loss."""
    sensor = RangeSensor(
        max_range=reach, std=0.03, resolution=0.01, aperture=math.radians(25.0),
        max_incidence=math.radians(50.0), random_share=0.0,
    )  # fmt: skip
    return RangeScanner.ring(sensor, 16, 0.2)


def mixed() -> RangeScanner:
    """A laser off the centre, turned, and a few sonars."""
    sensor = RangeSensor(max_range=4.0, std=0.02, resolution=0.001, random_share=0.0)
    fan = RangeScanner.planar(sensor, 31, math.radians(200.0), (0.25, -0.1, 0.4))
    return RangeScanner.mixed(fan, sonar_ring())


def figure_eight(steps: int, centre: tuple[float, float] = (2.6, 2.4)) -> Floats:
    """Poses (steps, 3) of a robot that drives a loop and looks along it, in the L-shaped room."""
    s = np.linspace(0.0, 2 * math.pi, steps)
    x, y = centre[0] + 1.6 * np.sin(s), centre[1] + 1.5 * np.sin(s) * np.cos(s) + 0.4 * np.cos(s)
    heading = np.arctan2(np.gradient(y), np.gradient(x))
    return np.column_stack((x, y, heading))


def free_poses(env: Environment, count: int, seed: int, clearance: float = 0.3) -> Floats:
    rng = np.random.default_rng(seed)
    xmin, ymin, xmax, ymax = env.bounds
    poses = rng.uniform((xmin, ymin, -math.pi), (xmax, ymax, math.pi), (20 * count, 3))
    return poses[np.asarray(env.is_free(poses[:, 0], poses[:, 1], clearance))][:count]


def turned(angle: Floats | float) -> Floats | float:
    """The angle in [-pi, pi)."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
