"""Registration of a log's frame to the frame of a map, by its scans alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.optimize import minimize

from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import compose
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.logs.log import Log
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError

# Readings beyond this show less of the frame than of the heading's error in each pose.
REACH: Final = 15.0
# Maximum number of beams used, evenly chosen from all.
MOST_BEAMS: Final = 30_000
# A beam farther from a wall than this counts as this far: first to find the valley from half a
# metre away, then so that what the map does not know (people, doors) weighs little.
CAPS: Final = (1.0, 0.3)
# First steps of the search, metres and radians.
STEP: Final = (0.1, 0.1, 0.03)


@dataclass(frozen=True)
class Registration:
    """Motion that aligns a log with a map.

    Attributes:
        motion: x, y, theta of the log's frame in the map's, metres and radians.
        before: Median distance from the end of a beam to the nearest wall at the log's poses as
            they are, metres.
        after: The same at the poses moved by `motion`.
    """

    motion: tuple[float, float, float]
    before: float
    after: float

    def applied(self, log: Log) -> Log:
        """Return a log with its poses in the map's frame.

        Raises:
            InputError: the log has no poses.
        """
        return replace(log, poses=compose(self.motion, log.required_poses()))


def register(log: Log, environment: Environment) -> Registration:
    """Find the rigid motion under which a log's scans fit a map best.

    LayerContext truth is often measured, or worked out, in a frame of its own: then every localizer
    shows an error that is none. The scans at the poses of the log tell the two frames apart
    without any localizer. The motion minimizes the mean distance from the ends of the beams to
    the nearest wall, each at most 0.3 m (a robust form of scan matching, for all scans at once).
    The search is local: frames may differ by half a metre and some degrees.

    Judge a localizer on scans that the motion was not found with (`log.chosen`).

    Raises:
        InputError: the log has no poses, most of them lie outside of the map, or no beam of it
            returns.
    """
    log.check_environment(environment)
    field = LikelihoodField.of(environment)
    ends = _beam_ends(log)
    centre = ends.mean(axis=0)
    away = ends - centre

    def distances(motion: Floats) -> Floats:
        # About the middle of what is seen, so that turn and shift hardly depend on each other.
        c, s = math.cos(motion[2]), math.sin(motion[2])
        x = centre[0] + motion[0] + c * away[:, 0] - s * away[:, 1]
        y = centre[1] + motion[1] + s * away[:, 0] + c * away[:, 1]
        rows = (y - field.origin[1]) / field.resolution
        columns = (x - field.origin[0]) / field.resolution
        sampled = map_coordinates(field.distance, [rows, columns], order=1, mode="nearest")
        return np.asarray(sampled, dtype=np.float64)

    best = np.zeros(3)
    for cap in CAPS:
        corners = np.vstack([best, best + np.diag(STEP)])
        options = {"xatol": 1e-4, "fatol": 1e-7, "initial_simplex": corners}
        best = minimize(
            lambda motion, cap=cap: float(np.minimum(distances(motion), cap).mean()),
            best,
            method="Nelder-Mead",
            options=options,
        ).x
    c, s = math.cos(best[2]), math.sin(best[2])
    x = centre[0] + best[0] - (c * centre[0] - s * centre[1])
    y = centre[1] + best[1] - (s * centre[0] + c * centre[1])
    return Registration(
        (float(x), float(y), float(best[2])),
        float(np.median(distances(np.zeros(3)))),
        float(np.median(distances(best))),
    )


def _beam_ends(log: Log) -> Floats:
    """Compute where beams end at the log's poses, shape (N, 2), metres."""
    seen = np.isfinite(log.ranges) & (log.ranges > 0.0) & (log.ranges < REACH)
    scan, beam = np.nonzero(seen)
    if len(scan) == 0:
        raise InputError(
            f"{log.source or log.name}: no beam of it returns from less than {REACH:g} m, so it "
            "cannot be laid on a map."
        )
    chosen = slice(None, None, math.ceil(len(scan) / MOST_BEAMS))
    scan, beam = scan[chosen], beam[chosen]
    poses, length = log.laser_poses[scan], log.ranges[scan, beam].astype(np.float64)
    bearing = poses[:, 2] + log.angles[beam]
    ends: Floats = poses[:, :2] + length[:, None] * np.column_stack(
        [np.cos(bearing), np.sin(bearing)]
    )
    return ends
