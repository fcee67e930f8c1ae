"""Stretches of a route on which robots get lost, and the kind of error that loses them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from ambinav.runtime.array_types import Bools, Floats

if TYPE_CHECKING:
    from ambinav.forecasting.ensemble import LostRule


OPEN, SLIDING, TURNING, DRIFT = "open floor", "sliding", "heading", "drift"
_HOW: Final = {
    OPEN: "where nothing in range tells the position",
    SLIDING: "where nothing tells the position along one direction",
    TURNING: "by its heading",
    DRIFT: "though scans tell the position there: the localizer corrects it too slowly",
}
FEW: Final = 0.1
"""A place belongs to a stretch if at least this share of the largest loss per place is there."""
LEAST: Final = 0.1
"""Stretches with less than this share of all losses are left out, and those that lose fewer than"""
FEWEST: Final = 0.001
"""this share of all robots."""
SHORT: Final = 2.0
"""Metres of a stretch up to which its worst place stands for all of it."""
ROUND: Final = 0.5
"""Error across the weak direction, as a share of that along it, from which floor counts as open."""


@dataclass(frozen=True)
class Cause:
    """Stretch of a route on which robots get lost.

    Attributes:
        probability: Share of all robots that get lost there.
        start: Metres along the route.
        end: Metres along the route.
        x: Where most get lost, metres, map frame.
        y: The same.
        kind: `OPEN`, `SLIDING` or `TURNING`: the error that grows there; `DRIFT` of the position on
            localizable floor.
        direction: Direction along which the error is largest, radians, [0, pi).
    """

    probability: float
    start: float
    end: float
    x: float
    y: float
    kind: str
    direction: float

    @property
    def plain(self) -> dict[str, float | str]:
        """Plain data for documents, with units in the names."""
        return {
            "probability": round(self.probability, 6),
            "start_m": round(self.start, 3),
            "end_m": round(self.end, 3),
            "x_m": round(self.x, 3),
            "y_m": round(self.y, 3),
            "kind": self.kind,
            "direction_rad": round(self.direction, 4),
        }

    def __str__(self) -> str:
        """Return place and kind in words."""
        place = f"({self.x:.1f}, {self.y:.1f}) m"
        if self.end - self.start <= SHORT:
            return f"most of them near {place}, {_HOW[self.kind]}"
        return (
            f"most of them from {self.start:.1f} to {self.end:.1f} m along the route, at the "
            f"highest rate near {place}, {_HOW[self.kind]}"
        )


def causes_of(
    poses: Floats,
    along: Floats,
    lost: Floats,
    covariance: Floats,
    rule: LostRule,
    localizable: Bools,
) -> tuple[Cause, ...]:
    """Return the stretches on which robots get lost, the worst first.

    Args:
        poses: Shape (n, 3).
        along: Metres up to each pose, shape (n,).
        lost: Share lost up to each pose, shape (n,).
        covariance: Of the robots that are not lost, shape (n, 3, 3).
        rule: When a robot is lost.
        localizable: Whether scans tell the position there, shape (n,).
    """
    losses = np.diff(lost, prepend=lost[:1])
    if not losses.max(initial=0.0) > 0.0:
        return ()
    many = losses >= FEW * losses.max()
    edges = np.flatnonzero(np.diff(many.astype(np.int8), prepend=0, append=0))
    causes = []
    for first, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        share = float(losses[first:end].sum())
        if share < max(LEAST * lost[-1], FEWEST):
            continue
        worst = first + int(losses[first:end].argmax())
        kind, direction = _kind(covariance[worst], float(poses[worst, 2]), rule)
        if localizable[worst] and kind != TURNING:
            kind = DRIFT
        x, y = poses[worst, :2].tolist()
        start = float(along[max(first - 1, 0)])
        causes.append(Cause(share, start, float(along[end - 1]), x, y, kind, direction))
    return tuple(sorted(causes, key=lambda cause: -cause.probability))


def _kind(covariance: Floats, theta: float, rule: LostRule) -> tuple[str, float]:
    variances, vectors = np.linalg.eigh(covariance[:2, :2])
    across, along = np.sqrt(np.maximum(variances, 0.0)).tolist()
    direction = math.atan2(vectors[1, 1], vectors[0, 1]) % math.pi
    off = along / rule.position
    if rule.lateral is not None:
        c, s = math.cos(theta), math.sin(theta)
        ahead, left = np.array([[c, s], [-s, c]])
        off = max(
            math.sqrt(axis @ covariance[:2, :2] @ axis) / limit
            for axis, limit in ((ahead, rule.position), (left, rule.lateral))
        )
    if math.sqrt(covariance[2, 2]) / rule.heading > off:
        return TURNING, direction
    return (OPEN if across > ROUND * along else SLIDING), direction
