"""Split of a log: a map is made of one part of the path, and compared with another's scans."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.geometry.environment import Environment
from ambinav.logs.log import Log
from ambinav.map_building.build import BEAMS_PER_TURN
from ambinav.runtime.errors import InputError
from ambinav.sensing.mounting import CENTRE
from ambinav.sensing.scanner import RangeScanner

# Readings this near to what the map says, metres, agree with it.
NEAR: Final = 0.5
# Share of the readings that must agree, of so many scans at most.
LEAST_NEAR: Final = 0.4
MOST_SCANS: Final = 200


def as_seen_from_laser(log: Log) -> Log:
    """Return the log as of a robot that is its laser: mount in the centre, beams in rising order.

    Raises:
        InputError: the log has no poses, or one beam alone.
    """
    if log.beams < 2:
        raise InputError(f"{log.source or log.name}: it has one beam; give scans of two or more.")
    order = np.argsort(log.angles, kind="stable")
    return replace(
        log,
        angles=log.angles[order],
        ranges=log.ranges[:, order],
        poses=log.laser_poses,
        mount=CENTRE,
    )


def stretches(log: Log, length: float, parts: int = 2) -> NDArray[np.intp]:
    """Return the part of each scan, shape (S,); stretches of the path take turns.

    Args:
        log: Scans with poses.
        length: Length of a stretch, metres.
        parts: How many parts there are.
    """
    steps = np.hypot(*np.diff(log.required_poses()[:, :2], axis=0).T)
    gone = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(np.floor(gone / length).astype(np.intp) % parts)


def scanner_of(log: Log, max_range: float | None) -> RangeScanner:
    """Return the beams of a log used for its map: 60 a turn at most (see `build_map`)."""
    scanner = log.scanner(max_range=max_range)
    beams = max(round(BEAMS_PER_TURN * scanner.aperture / (2.0 * math.pi)), 1)
    return scanner.thinned(beams)


def model_of(scanner: RangeScanner, environment: Environment, radius: float) -> AmbiguityModel:
    """Return the default parameters of `build_map`."""
    return AmbiguityModel(radius=radius, map_std=environment.map_std, tau=independent_tau(scanner))


def check_scans(log: Log, environment: Environment) -> None:
    """Check that a log belongs to a map: its poses are on it, and its scans fit it.

    Args:
        log: Log of a robot that is its laser (`as_seen_from_laser`).
        environment: The map.

    Raises:
        InputError: fewer than half of the poses lie in the free space, or the readings are not
            those of the map.
    """
    log.check_environment(environment)
    x, y, theta = log.required_poses().T
    index = np.flatnonzero(np.asarray(environment.is_free(x, y)))
    index = index[:: math.ceil(len(index) / MOST_SCANS)]
    expected = log.scanner().scan(environment, x[index], y[index], theta[index])
    read = log.ranges[index]
    returned = np.isfinite(read) & np.isfinite(expected)
    near = np.abs(read[returned] - expected[returned]) <= NEAR
    if returned.any() and near.mean() >= LEAST_NEAR:
        return
    share = float(near.mean()) if returned.any() else 0.0
    raise InputError(
        f"{log.source or f'log {log.name!r}'}: {share:.0%} of its readings are within {NEAR:g} m "
        f"of what environment {environment.name!r} says, and of a log of the same place at least "
        f"{LEAST_NEAR:.0%} are: give the map that belongs to the log."
    )
