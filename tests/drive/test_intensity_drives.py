"""Drives past a tag: repeatable, and what they were where nobody reads intensities."""

from __future__ import annotations

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.drive.drive import drive_route
from ambinav.drive.drives import Drives
from ambinav.drive.people import People
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import WALL, Segments
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.parameters import MclParameters
from ambinav.sensing import Intensity, RangeScanner
from tests.drive.cases import laser, route_through

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

TAGGED = environment_from_shapes([shapely.box(0, 0, 30, 2.4)], reflectors=[[(5, 0), (5.5, 0)]])
ROUTE = route_through([[2.0, 1.2], [8.0, 1.2]])
CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
FEW = MclParameters(min_particles=200, max_particles=200)


def drives(env: Environment, scanner: RangeScanner, localizer: object, **more: object) -> Drives:
    """Three runs past the tag, with people about."""
    if localizer == "kalman":
        localizer = ExtendedKalmanFilter(env, scanner, runs=3)
    return drive_route(
        env, scanner, Robot(), ROUTE, localizer, np.random.default_rng(5), 3, people=People(2),
        **more,
    )  # fmt: skip


def same(one: Drives, two: Drives) -> bool:
    """To the last bit."""
    names = ("truth", "odometry", "estimate", "covariance")
    return all(np.array_equal(getattr(one, n), getattr(two, n), equal_nan=True) for n in names)


@pytest.mark.parametrize("localizer", [FEW, "kalman"], ids=["mcl", "kalman"])
def test_intensities_change_a_drive_and_nothing_else_does(localizer: object) -> None:
    """Not the walls' kind without a channel, nor a channel without reflectors."""
    walls = np.full_like(TAGGED.segments.kind, WALL)
    plain = Environment(Segments(TAGGED.segments.xy, walls), TAGGED.free)
    ranges, both = laser(beams=36), laser(beams=36).with_intensity(CHANNEL)
    read = drives(TAGGED, both, localizer)
    assert same(read, drives(TAGGED, both, localizer))
    unread = [
        drives(env, scanner, localizer)
        for env, scanner in ((plain, ranges), (plain, both), (TAGGED, ranges))
    ]
    assert same(unread[0], unread[1])
    assert same(unread[0], unread[2])
    assert not same(unread[0], read)
    # A world that has lost its tags, or a map that knows of none.
    for env, world in ((TAGGED, plain), (plain, TAGGED)):
        blind = drives(env, both, localizer, world=world)
        assert same(blind, unread[0]) == (env is plain)
