"""How localizable the robot is now, and which state that is; no ROS is imported here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike

from ambinav import Environment, InputError, RangeScanner, online_localizability


class State(IntEnum):
    """As the levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Localizability:
    """What a scan leaves of the prior.

    Attributes:
        along: Standard deviation of the place along its weak direction, metres.
        across: The same across it.
        direction: Of the weak direction, radians in [0, pi), map frame.
        explained: Share of the expected echoes that the map explains; nan where none is expected.
        beams: Number of beams with a reading.
    """

    along: float
    across: float
    direction: float
    explained: float
    beams: int


def measure(
    environment: Environment,
    scanner: RangeScanner,
    pose: Sequence[float],
    ranges: ArrayLike,
    prior: Sequence[float],
    uncertainty: Sequence[float],
) -> Localizability:
    """Measure how well a scan fixes the pose that it was made at.

    Args:
        environment: The building of the map.
        scanner: With B beams.
        pose: x, y (metres) and theta (radians) of the robot, map frame.
        ranges: Readings as `conversions.beams_of` gives them, shape (B,).
        prior: Standard deviations of the pose before the scan: metres, metres, radians.
        uncertainty: How far `pose` may be off, the same.

    Raises:
        InputError: see `online_localizability`.
    """
    found = online_localizability(
        environment,
        scanner,
        np.array([pose], dtype=np.float64),
        ranges,
        prior=np.diag(np.square(prior)),
        uncertainty=np.diag(np.square(uncertainty)),
    )
    along, across, direction = (float(values[0]) for values in found.radii)
    beams = int((~np.isnan(np.asarray(ranges, dtype=np.float64))).sum())
    return Localizability(along, across, direction, float(found.explained[0]), beams)


@dataclass(frozen=True)
class Thresholds:
    """From where on a robot is badly localizable.

    Attributes:
        warn: Metres along the weak direction.
        error: Metres, at least `warn`.
        explained: Least share of the expected echoes that the map must explain, 0 to 1.
        hysteresis: Share by which a value must be better than a threshold to leave its state,
            below 1.
    """

    warn: float = 0.10
    error: float = 0.25
    explained: float = 0.5
    hysteresis: float = 0.2

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            InputError: one cannot be used.
        """
        if not 0.0 < self.warn <= self.error < math.inf:
            raise InputError(
                f"warn, error: {self.warn:g} m and {self.error:g} m; give 0 < warn <= error."
            )
        for name in ("explained", "hysteresis"):
            value = getattr(self, name)
            if not 0.0 <= value < 1.0:
                raise InputError(f"{name}: {value:g} is not a share; give 0 or more, below 1.")


class Monitor:
    """The state of a robot, scan after scan.

    A state is entered where a value passes its threshold, and left only where it is better by the
    hysteresis: a value that trembles about a threshold does not make the state tremble.

    Attributes:
        state: After the last scan.
        text: Why.
    """

    def __init__(self, thresholds: Thresholds) -> None:
        self._thresholds = thresholds
        self._along, self._unexplained = State.OK, False
        self.state, self.text = State.STALE, "no scan yet"

    def update(self, now: Localizability) -> State:
        """Take a measurement and say the state."""
        t = self._thresholds
        better = 1.0 - t.hysteresis
        limits = {State.WARN: t.warn, State.ERROR: t.error}
        reached = [
            state
            for state, limit in limits.items()
            if now.along >= limit * (better if self._along >= state else 1.0)
        ]
        self._along = max(reached, default=State.OK)
        # Where no echo is expected there is nothing to explain.
        least = 1.0 - (1.0 - t.explained) * better if self._unexplained else t.explained
        self._unexplained = now.explained < least
        self.state = max(self._along, State.WARN if self._unexplained else State.OK)
        why = []
        if self._along > State.OK:
            degrees = math.degrees(now.direction)
            why.append(f"the place is known to {now.along:.2f} m along {degrees:.0f} degrees")
        if self._unexplained:
            why.append(f"the map explains {now.explained:.0%} of the echoes")
        self.text = "; ".join(why) or "localizable"
        return self.state

    def stale(self, why: str) -> State:
        """Say that nothing can be measured; the thresholds begin anew."""
        self._along, self._unexplained = State.OK, False
        self.state, self.text = State.STALE, why
        return self.state
