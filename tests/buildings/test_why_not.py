"""What a collision checker says: why a pose is not free, where the next free one is, bad input."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.geometry.motion.steering import Steering
from ambinav.geometry.segments import Segments
from ambinav.runtime.errors import InputError
from tests.geometry import scenes

BODY = [(-0.3, -0.25), (0.45, -0.25), (0.55, 0.0), (0.45, 0.25), (-0.3, 0.25)]


@pytest.fixture(scope="module")
def hall() -> Environment:
    """A hall of 10 x 6 m whose right side is a frontier, with a block of 2 x 2 m in it."""
    free = shapely.box(0, 0, 10, 6) - shapely.box(3, 2, 5, 4)
    xy = scenes.rings(free)
    right = (xy[:, 0] == 10.0) & (xy[:, 2] == 10.0)
    return Environment(Segments(xy, right), free)


@pytest.mark.parametrize(
    ("x", "y", "expected"),
    [
        (1.0, 1.0, None),
        (12.0, 1.0, "outside of the map, which reaches from (0.00, 0.00) to (10.00, 6.00)"),
        (3.1, 3.0, "in a wall, 0.1 m deep"),
        (4.0, 3.0, "behind a wall, 1.00 m from the free space"),
        (0.12, 1.0, "0.12 m from a wall, the footprint needs 0.25 m"),
        (0.004, 1.0, "0.004 m from a wall, the footprint needs 0.25 m"),
        (0.2499, 1.0, "0.2499 m from a wall, the footprint needs 0.25 m"),
        (9.9, 3.0, "0.10 m from unknown space, the footprint needs 0.25 m"),
    ],
)
def test_why_not(hall: Environment, x: float, y: float, expected: str | None) -> None:
    checker = CollisionChecker(hall, Footprint.disc(0.25), Steering())
    assert checker.why_not(x, y) == expected


def test_why_not_of_unknown_space_and_polygons(hall: Environment) -> None:
    free = hall.free - shapely.box(8, 2, 9, 4)
    xy = scenes.rings(free)
    env = Environment(Segments(xy, (xy[:, 0] >= 8.0) & (xy[:, 0] <= 9.0)), free)
    checker = CollisionChecker(env, Footprint.polygon(BODY), Steering("se2"))
    assert checker.why_not(8.2, 3.0) == "in unknown space"
    reason = checker.why_not(0.4, 1.0, math.pi)
    assert reason == "0.40 m from a wall, which the footprint touches at this heading"
    assert checker.why_not(0.4, 1.0, 0.0) is None


def test_nearest_free(hall: Environment) -> None:
    checker = CollisionChecker(hall, Footprint.disc(0.25), Steering())
    for x, y, expected in ((0.1, 3.0, 0.15), (3.1, 3.0, 0.35), (-2.0, 3.0, 2.25), (1.0, 1.0, 0.0)):
        found = checker.nearest_free(x, y, 0.3)
        assert found is not None
        assert checker.poses_free([found[:3]])[0] and found[2] == 0.3
        assert found[3] == pytest.approx(math.hypot(found[0] - x, found[1] - y))
        assert expected - 1e-9 <= found[3] <= expected + 0.02


def test_nearest_free_of_a_polygon_and_of_none(hall: Environment) -> None:
    checker = CollisionChecker(hall, Footprint.polygon(BODY), Steering("se2"))
    found = checker.nearest_free(0.1, 3.0, 0.0)
    assert found is not None and 0.2 <= found[3] <= 0.22
    assert CollisionChecker(hall, Footprint.disc(4.0), Steering()).nearest_free(1, 1) is None


def test_bad_input(hall: Environment) -> None:
    checker = CollisionChecker(hall, Footprint.disc(0.25), Steering())
    with pytest.raises(InputError, match=r"poses\[0\]"):
        checker.poses_free([[math.nan, 0.0, 0.0]])
    with pytest.raises(InputError, match="as many"):
        checker.motions_free(np.zeros((2, 3)), np.zeros((3, 3)))
    with pytest.raises(InputError, match="axes"):
        CollisionChecker(
            hall, Footprint.disc(0.2), Steering(), forbidden=np.zeros(3, dtype=np.bool_)
        )
    with pytest.raises(InputError, match="spacing"):
        CollisionChecker(
            hall,
            Footprint.disc(0.2),
            Steering(),
            forbidden=np.zeros((3, 3), dtype=np.bool_),
            spacing=0.0,
        )
