"""Speed bound of the localization error: closed form, brute force over the ellipse, a corridor."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from ambinav.forecasting.braking import BrakingRule, free_distance
from ambinav.runtime.errors import InputError

RULE = BrakingRule(radius=0.2, acceleration=0.5, reaction=0.3, creep=0.05)


class Corridor:
    """Map of a corridor along x, walls at y = 0 and 2 m, in place of an `AmbiguityMap`."""

    def sample(self, layer, x, y):
        assert layer == "clearance"
        clearance = np.minimum(y, 2.0 - y)
        return np.where(clearance > 0.0, clearance, np.nan)


def test_the_robot_stops_within_the_room_that_there_is():
    room = np.linspace(0.03, 4.0, 50)
    speed = RULE.speeds(room)
    np.testing.assert_allclose(speed * 0.3 + speed**2 / (2.0 * 0.5), room, rtol=1e-12)
    assert RULE.speeds([-1.0, 0.0, 0.01]).tolist() == [0.05] * 3
    at_once = BrakingRule(radius=0.0, acceleration=0.5, reaction=0.0)
    assert float(at_once.speeds(1.0)) == pytest.approx(math.sqrt(2.0 * 0.5))


@pytest.mark.parametrize("turn", [0.0, 0.4, math.pi / 2])
def test_the_nearest_wall_is_that_of_the_ellipse(turn):
    """The ellipse of k sigma reaches k sqrt(n' P n) towards a wall with the normal n."""
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    covariance = np.zeros((1, 3, 3))
    covariance[0, :2, :2] = rotation @ np.diag([0.2**2, 0.05**2]) @ rotation.T
    found = free_distance(Corridor(), np.array([[5.0, 0.9, 0.0]]), covariance, 3.0)
    due = 0.9 - 3.0 * math.sqrt(covariance[0, 1, 1])
    assert found[0] == pytest.approx(due, abs=0.02 * 3.0 * 0.2) and found[0] >= due - 1e-12
    # Whoever may be in a wall has no room.
    assert free_distance(Corridor(), np.array([[5.0, 0.9, 0.0]]), covariance + 1.0, 3.0) == 0.0


def test_only_the_error_towards_walls_slows_the_robot():
    """Lost along a corridor it drives on; lost across it creeps, and says how far."""
    along, across = np.diag([0.5**2, 0.01**2, 1e-4]), np.diag([0.01**2, 0.5**2, 1e-4])
    forecast = SimpleNamespace(
        poses=np.array([[1.0, 1.0, 0.0], [2.0, 1.0, 0.0], [4.0, 1.0, 0.0]]),
        distance=np.array([0.0, 1.0, 3.0]),
        covariance=np.stack([along, along, across]),
    )
    bound = RULE.bound(Corridor(), forecast)
    assert bound[:, 0].tolist() == [0.0, 1.0, 3.0]
    assert bound[:2, 1] == pytest.approx(float(RULE.speeds(0.8 - 0.03)), rel=0.02)
    assert (bound[2, 1], RULE.creep_metres(bound)) == (0.05, 2.0)


@pytest.mark.parametrize(
    ("field", "value"), [("radius", -1.0), ("sigmas", math.nan), ("creep", 0.0), ("reaction", -0.1)]
)
def test_a_rule_of_no_use_is_refused(field, value):
    with pytest.raises(InputError, match=f"braking rule: {field} is {value:g}"):
        BrakingRule(**{"radius": 0.2, "acceleration": 1.0, field: value})
