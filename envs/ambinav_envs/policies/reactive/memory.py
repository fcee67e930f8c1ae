"""Echoes over time: confirmation by a second scan, and memory of those out of view."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ambinav.runtime.array_types import Bools, Floats
from ambinav_envs.policies.reactive.echoes import Points, ScanPoints

NEAR: Final = 0.15
"""An echo is confirmed by one of the scan before that is this near, metres ..."""
NEAR_SHARE: Final = 0.15
"""... plus this share of its distance: beams of a robot that turns hit other points of a wall."""


class EchoFilter:
    """Removes echoes that the previous scan does not confirm, such as random readings.

    With one random reading in a hundred, 45 % of the scans of 60 beams contain one. Cells of the
    grid of Ulrich and Borenstein (1998) become certain by repeated echoes; here two in a row
    suffice, so that an obstacle is detected a time step later.
    """

    def __init__(self) -> None:
        self._x = self._y = np.empty((0, 0))

    def confirmed(
        self, x: Floats, y: Floats, turned: Floats, moved: Floats, starts: Bools
    ) -> Points:
        """Return the points, shape (N, P) each, metres; inf for those that are not confirmed.

        Args:
            x: X of the present scans, shape (N, P), metres; inf: none.
            y: The same.
            turned: Radians since the last call, shape (N,).
            moved: Metres likewise, along the arc.
            starts: Whose episode has just begun, so that every echo counts, shape (N,).
        """
        first = starts | (self._x.shape != x.shape)
        if self._x.shape != x.shape:
            self._x, self._y = x, y
        old_x, old_y = seen_after(self._x[:, :, None], self._y[:, :, None], turned, moved)
        is_seen, was_seen = np.isfinite(x), np.isfinite(old_x)
        px, py = np.where(is_seen, x, 0.0), np.where(is_seen, y, 0.0)
        # Far from everything, so that the distances stay finite.
        ox, oy = np.where(was_seen, old_x, 1e6), np.where(was_seen, old_y, 1e6)
        squared = (px[:, None, :] - ox) ** 2 + (py[:, None, :] - oy) ** 2
        near = (NEAR + NEAR_SHARE * np.hypot(px, py)) ** 2
        good = is_seen & (first[:, None] | (squared.min(axis=1) <= near))
        self._x, self._y = x, y
        return np.where(good, x, np.inf), np.where(good, y, np.inf)


class EchoMemory:
    """Points of earlier scans that are out of view, moved by the robot's speeds.

    A scanner that looks ahead does not see the corner that the robot is turning round. Ulrich and
    Borenstein (1998) keep a grid for this.

    Args:
        scan_points: Scan points of the scanner; of one that looks all around nothing is remembered.
        seconds: For how long.
        dt: Time step, seconds.
        every: Time between the scans that are kept, seconds.
    """

    def __init__(self, scan_points: ScanPoints, seconds: float, dt: float, every: float) -> None:
        self._scan_points = scan_points
        self._stride = max(1, round(every / dt))
        self._slots = 0 if scan_points.all_around else round(seconds / (self._stride * dt))
        self._step = 0
        self._x = self._y = np.empty((0, 0, 0))

    def recall(self, x: Floats, y: Floats, turned: Floats, moved: Floats, starts: Bools) -> Points:
        """Return these points and the remembered ones, shape (N, P + Q) each, metres.

        Args:
            x: X of the present scans, shape (N, P).
            y: The same.
            turned: Radians since the last call, shape (N,).
            moved: Metres likewise, along the arc.
            starts: Robots whose episode has just begun, bool, shape (N,).
        """
        if self._slots == 0:
            return x, y
        shape = (len(x), self._slots, x.shape[1])
        if self._x.shape != shape:
            self._x, self._y = np.full((2, *shape), np.inf)
        self._x[starts] = self._y[starts] = np.inf
        self._x, self._y = seen_after(self._x, self._y, turned, moved)
        angle = np.arctan2(self._y, self._x)
        out_of_view = np.isfinite(self._x)
        out_of_view[out_of_view] = ~self._scan_points.in_view(angle[out_of_view])
        old_x = np.where(out_of_view, self._x, np.inf).reshape(len(x), -1)
        old_y = np.where(out_of_view, self._y, np.inf).reshape(len(x), -1)
        if self._step % self._stride == 0:
            slot = self._step // self._stride % self._slots
            self._x[:, slot], self._y[:, slot] = x, y
        self._step += 1
        return np.concatenate([x, old_x], axis=1), np.concatenate([y, old_y], axis=1)


def seen_after(x: Floats, y: Floats, turned: Floats, moved: Floats) -> Points:
    """Transform points to the frame of a robot after an arc, shape (N, K, P) each, metres.

    Args:
        x: In its frame before that, shape (N, K, P); inf: none.
        y: The same.
        turned: Radians, shape (N,).
        moved: Metres along the arc, shape (N,).
    """
    half = 0.5 * turned
    chord = moved * np.sinc(half / math.pi)
    along, across = (chord * np.cos(half))[:, None, None], (chord * np.sin(half))[:, None, None]
    cos, sin = np.cos(turned)[:, None, None], np.sin(turned)[:, None, None]
    finite = np.isfinite(x)
    dx, dy = np.where(finite, x, 0.0) - along, np.where(finite, y, 0.0) - across
    return (
        np.where(finite, cos * dx + sin * dy, np.inf),
        np.where(finite, cos * dy - sin * dx, np.inf),
    )
