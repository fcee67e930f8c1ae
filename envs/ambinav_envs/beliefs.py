"""The pose with its covariance that a robot gives, and the numbers of an action for it.

With `NavigationParameters.belief` an action ends in nine numbers, all of which are valid:

| number | meaning | from -1 to 1 |
|---|---|---|
| 0, 1 | offset of the position ahead and to the left of the estimate that it observes by | \
-10 to 10 m |
| 2 | offset of the heading | -pi to pi |
| 3, 4 | deviations ahead and to the left | 0.01 to 10 m, by ratios |
| 5 | deviation of the heading | 0.005 to 1.5 rad, by ratios |
| 6, 7, 8 | partial correlations: of ahead and left, of ahead and heading, of left and heading \
given ahead | -0.99 to 0.99 |

Any partial correlations between -1 and 1 give a positive definite matrix (Lewandowski, Kurowicka &
Joe 2009, section 2).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav_envs.simulation.belief import LEAST_STD, MOST_CORRELATION, MOST_STD, NUMBERS, REACH

_REACH, _LEAST, _MOST = np.array(REACH), np.array(LEAST_STD), np.array(MOST_STD)


class Beliefs(NamedTuple):
    """Normal beliefs of N robots about their pose.

    Attributes:
        offset: Mean, relative to the estimate that the robot observes by and in the frame of that
            pose: ahead, left (metres), heading (radians); shape (N, 3).
        covariance: In the same frame, shape (N, 3, 3).
    """

    offset: Floats
    covariance: Floats


def as_beliefs(numbers: ArrayLike) -> Beliefs:
    """Convert numbers of actions to beliefs; what is beyond [-1, 1] is cut off.

    Args:
        numbers: Shape (N, 9), see this module.

    Raises:
        InputError: the shape is another, or a number is not finite.
    """
    table = np.asarray(numbers, dtype=np.float64)
    if table.ndim != 2 or table.shape[1] != NUMBERS or not np.isfinite(table).all():
        raise InputError(
            f"belief: the numbers have the shape {table.shape}; give finite ones, (N, {NUMBERS})."
        )
    shares = np.clip(table, -1.0, 1.0)
    std = _LEAST * (_MOST / _LEAST) ** (0.5 * (shares[:, 3:6] + 1.0))
    a, b, c = MOST_CORRELATION * shares[:, 6:].T
    ra, rb, rc = np.sqrt(1.0 - a * a), np.sqrt(1.0 - b * b), np.sqrt(1.0 - c * c)
    zero = np.zeros_like(a)
    rows = [[zero + 1.0, zero, zero], [a, ra, zero], [b, c * rb, rb * rc]]
    factor = std[:, :, None] * np.moveaxis(np.array(rows), 2, 0)
    return Beliefs(_REACH * shares[:, :3], factor @ factor.transpose(0, 2, 1))


def belief_numbers(offset: ArrayLike, covariance: ArrayLike) -> Floats:
    """Convert beliefs to numbers of actions, shape (N, 9): the inverse of `as_beliefs`.

    Offsets, deviations and partial correlations beyond their limits are cut off there.

    Args:
        offset: See `Beliefs`, shape (N, 3).
        covariance: See `Beliefs`, shape (N, 3, 3).

    Raises:
        InputError: a shape is another, a number is not finite, or a covariance is not symmetric or
            not positive definite.
    """
    offsets, cov = np.asarray(offset, dtype=np.float64), np.asarray(covariance, dtype=np.float64)
    if offsets.ndim != 2 or offsets.shape[1] != 3 or cov.shape != (len(offsets), 3, 3):
        raise InputError(
            f"belief: offset and covariance have the shapes {offsets.shape} and {cov.shape}; give "
            "(N, 3) and (N, 3, 3)."
        )
    if not np.isfinite(offsets).all():
        raise InputError("belief: offset has a number that is not finite; give metres and radians.")
    bad = np.asarray(~np.isfinite(cov).all(axis=(1, 2)))
    sound = np.where(bad[:, None, None], np.eye(3), cov)
    asymmetry = np.abs(sound - sound.transpose(0, 2, 1)).max(axis=(1, 2))
    bad |= asymmetry > 1e-9 * np.abs(sound).max(axis=(1, 2))
    bad |= np.linalg.eigvalsh(sound)[:, 0] <= 0.0
    if bad.any():
        i = int(bad.argmax())
        raise InputError(
            f"belief: the covariance of robot {i} is {cov[i].tolist()}; give a symmetric positive "
            "definite matrix."
        )
    std = np.sqrt(np.diagonal(cov, axis1=1, axis2=2))
    factor = np.linalg.cholesky(cov) / std[:, :, None]
    a, b = factor[:, 1, 0], factor[:, 2, 0]
    c = factor[:, 2, 1] / np.sqrt(np.maximum(1.0 - b * b, 1e-300))
    deviation = 2.0 * np.log(std / _LEAST) / np.log(_MOST / _LEAST) - 1.0
    heading = np.remainder(offsets[:, 2] + np.pi, 2.0 * np.pi) - np.pi
    pose = np.column_stack([offsets[:, :2], heading]) / _REACH
    correlation = np.column_stack([a, b, c]) / MOST_CORRELATION
    numbers = np.concatenate([pose, deviation, correlation], axis=1)
    return np.asarray(np.clip(numbers, -1.0, 1.0), dtype=np.float64)


def filter_belief(observations: Mapping[str, NDArray[np.floating]]) -> Floats:
    """Return the numbers of the localizer's own belief, as `uncertainty` shows it, shape (N, 9).

    Its correlations of position and heading are not observed, and are given as 0.

    Args:
        observations: Parts of the observation by name; `uncertainty`, shape (N, 5), is read.
    """
    along, across, cosine, sine, heading = observations["uncertainty"].T.astype(np.float64)
    # In single precision they are a little beyond the circle, which a thin ellipse does not stand.
    cosine, sine = np.stack([cosine, sine]) / np.maximum(np.hypot(cosine, sine), 1.0)
    mean, half = 0.5 * (along**2 + across**2), 0.5 * (along**2 - across**2)
    cov = np.zeros((len(along), 3, 3))
    cov[:, 0, 0], cov[:, 1, 1], cov[:, 2, 2] = (
        mean + half * cosine,
        mean - half * cosine,
        heading**2,
    )
    cov[:, 0, 1] = cov[:, 1, 0] = half * sine
    # Exact poses have deviations of 0.
    cov += 1e-4 * np.diag(_LEAST**2)
    return belief_numbers(np.zeros((len(along), 3)), cov)
