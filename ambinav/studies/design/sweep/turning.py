"""Comparison of one yaw for all places with the best yaw at each: should the scanner turn?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.drive.bootstrap import Interval
from ambinav.maps.zones import BAD
from ambinav.runtime.array_types import Bytes, Floats, Floats32, Ints
from ambinav.studies.design.sweep.figures import difference

WORTH: Final = 0.05
"""Turning is worth a drive if it takes this much off the mean level."""
NOWHERE: Final = -1
"""In `Turning.best`: the robot cannot stand there."""


@dataclass(frozen=True, eq=False)
class Turning:
    """A fixed yaw, and the best yaw at each of K places.

    The robot is taken to turn its scanner freely from place to place: a real drive gains less.

    Attributes:
        yaws: The tried yaws, degrees.
        fixed: Index of the best yaw for all places, by the mean level.
        best: Index of the best yaw at each place, int64, (K,), of equals the fixed one; or
            `NOWHERE`.
        fixed_mean: Mean level with the fixed yaw.
        turned_mean: Mean level with the best at each place.
        gain: The former less the latter, with its interval (`figures.difference`).
        fixed_bad: Share of corridor and open with the fixed yaw.
        turned_bad: Same with the best yaw at each place.
        shares: Share of the region where each yaw is best.
        gain_at: Decrease of the level by the best yaw at each place, shape (K,), nan where the
            robot cannot stand.
        standing: Share of the region where the robot can stand at every yaw: all figures are of
            that.
    """

    yaws: tuple[float, ...]
    fixed: int
    best: Ints
    fixed_mean: float
    turned_mean: float
    gain: Interval
    fixed_bad: float
    turned_bad: float
    shares: tuple[float, ...]
    gain_at: Floats
    standing: float

    @property
    def is_worth_it(self) -> bool:
        """True if the gain is at least `WORTH`, its interval included."""
        return bool(self.gain.low >= WORTH)


def turning(
    yaws: tuple[float, ...], level: Floats32, zone: Bytes, weight: Floats, of: int
) -> Turning | None:
    """Compare the yaws; None if the robot can stand at no place.

    Args:
        yaws: Y of them, degrees.
        level: Shape (Y, K), nan where the robot cannot stand.
        zone: Codes, shape (Y, K).
        weight: Weight of the places, shape (K,).
        of: Number of places that these represent.
    """
    fits = np.isfinite(level).all(axis=0)
    if not fits.any():
        return None
    levels, zones = level[:, fits].astype(np.float64), zone[:, fits]
    share = weight[fits] / weight[fits].sum()
    fixed = int(np.argmin(np.round(levels @ share, 9)))
    least = levels.min(axis=0)
    # Of equals the fixed yaw, so that no scanner is turned without a gain.
    best = np.where(levels[fixed] <= least + 1e-6, fixed, levels.argmin(axis=0))
    bad = np.isin(zones, BAD)
    each = np.arange(len(best))
    everywhere = np.full(len(weight), NOWHERE, dtype=np.int64)
    everywhere[fits] = best
    gain_at = np.full(len(weight), np.nan)
    gain_at[fits] = levels[fixed] - levels[best, each]
    return Turning(
        yaws=yaws,
        fixed=fixed,
        best=everywhere,
        fixed_mean=float(levels[fixed] @ share),
        turned_mean=float(levels[best, each] @ share),
        gain=difference(levels[fixed], levels[best, each], weight[fits], of, len(weight)),
        fixed_bad=float(bad[fixed] @ share),
        turned_bad=float(bad[best, each] @ share),
        shares=tuple(np.bincount(best, weights=share, minlength=len(yaws)).tolist()),
        gain_at=gain_at,
        standing=float(weight[fits].sum() / weight.sum()),
    )
