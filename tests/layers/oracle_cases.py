"""The buildings and scanners on which layers are held against brute force."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.sensing import RangeScanner, RangeSensor
from tests.layers import brute_rays

Floats = NDArray[np.float64]

BUILDINGS = ("drawn", pytest.param("recorded", marks=[pytest.mark.data_dir, pytest.mark.slow]))
"""The recorded one takes two to three times as long."""

DRAWN = Path(__file__).parents[2] / "configs" / "demo.geojson"
RECORDED = "maps_from_logs/freiburg-079.yaml"


def building(which: str, request: pytest.FixtureRequest) -> Environment:
    """The demo, or a corridor with offices as a robot recorded them."""
    if which == "drawn":
        return load_environment(DRAWN)
    data: Path = request.getfixturevalue("data_dir")
    return load_environment(data / RECORDED)


def laser(beams: int = 180) -> RangeScanner:
    """All around."""
    sensor = RangeSensor(max_range=5.0, min_range=0.1, std=0.03, resolution=0.01)
    return RangeScanner.planar(sensor, beams, 2 * math.pi, name="laser")


def sonars() -> RangeScanner:
    """Five cones that look ahead, off the robot's centre; oblique surfaces return no echo."""
    sensor = RangeSensor(
        max_range=3.0, min_range=0.1, std=0.04, resolution=0.01, aperture=math.radians(30.0),
        max_incidence=math.radians(25.0),
    )  # fmt: skip
    yaw = np.radians([-60.0, -30.0, 0.0, 30.0, 60.0])
    return RangeScanner.from_mounts(
        sensor, np.column_stack([0.1 * np.cos(yaw), 0.1 * np.sin(yaw), yaw]), name="sonars"
    )


def some(context: LayerContext, count: int, seed: int) -> list[tuple[int, int]]:
    """Running numbers of free cells and headings that the robot can stand at."""
    possible = np.argwhere(context.possible)
    rng = np.random.default_rng(seed)
    return [(int(p), int(h)) for p, h in rng.permutation(possible)[:count]]


def standing_poses(
    env: Environment, mounts: Floats, x: Floats, y: Floats, theta: Floats
) -> NDArray[np.bool_]:
    """Whether centre and sensors are in the free space, with no wall between."""
    good = shapely.contains_xy(env.free, x, y)
    for mx, my in np.unique(np.round(mounts[:, :2], 9), axis=0):
        off = math.hypot(mx, my)
        if off > 0.0:
            angle = theta + math.atan2(my, mx)
            found, _ = brute_rays.cast(env.segments.xy, x, y, angle, off)
            good &= ~np.isfinite(found)
    return np.asarray(good)
