"""Odometries by name, for commands and forecasts that ask how well a robot's wheels count."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from ambinav.config import nearest
from ambinav.drive.noise import OdometryNoise
from ambinav.runtime.errors import InputError

ODOMETRIES: Final[Mapping[str, OdometryNoise]] = {
    "good": OdometryNoise(scale=0.125),
    "mediocre": OdometryNoise(),
    "poor": OdometryNoise(scale=0.5),
    "amcl-default": OdometryNoise(scale=1.0),
}
"""Straight on, after a metre: 2.3 degrees and 3 cm off (good), 4.5 degrees and 6 cm (mediocre, what
simulated robots have), 9 degrees and 11 cm (poor), 18 degrees and 22 cm (AMCL's default alphas as
they are, which are meant to be wide)."""


def odometry_of(which: str | OdometryNoise | None) -> OdometryNoise:
    """Return an odometry by its name, or the given one; None: the simulated robot's.

    Raises:
        InputError: there is none of that name.
    """
    if which is None:
        return OdometryNoise()
    if isinstance(which, OdometryNoise):
        return which
    if which not in ODOMETRIES:
        raise InputError(f"odometry is {which!r}; {nearest(str(which), tuple(ODOMETRIES))}.")
    return ODOMETRIES[which]


def odometry_name(odometry: OdometryNoise) -> str:
    """Return the name of an odometry; "other" if it has none."""
    return next((name for name, noise in ODOMETRIES.items() if noise == odometry), "other")
