"""Calibration of a class of localizers to drives: its gains, and the odds of its lost shares.

Gains and odds are those that make the drives most likely (binomial, each route with its runs). How
good the forecasts are is said of buildings that took no part in the fit: for each of some folds of
buildings everything is fitted to the others. The score is Brier's skill against the base rate
(Brier 1950; Murphy 1973, "A new vector partition of the probability score"), of which what chance
does from run to run leaves at most the ceiling.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from ambinav.drive.bootstrap import Interval, grouped_weights, percentiles
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION
from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.filter_kernel import forecast_rows
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.localizer_class import LocalizerClass, log_odds
from ambinav.forecasting.reliability import reliability_of
from ambinav.runtime.array_types import Floats, Ints
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent
from ambinav.runtime.threads import share

FOLDS = 5
# Of a search: evaluations, and the size of its first steps in the logarithm of a gain.
EVALUATIONS, FIRST_STEP = 60, 0.7
# Logarithms of gains, at least and at most: of a position, sums of beams gain 1/5000 of a scan.
LOW_GAIN, HIGH_GAIN = -12.0, 10.0


@dataclass(frozen=True, eq=False)
class DrivenRoute:
    """A route that a localizer was driven along, again and again.

    Attributes:
        building: Name of the building; buildings are left out whole.
        field: Information of its map.
        poses: Poses along the route, an update apart, shape (n, 3), metres and radians, map frame.
        noise: Errors of the odometry.
        lost: In how many runs the robot got lost.
        runs: Of how many.
    """

    building: str
    field: InformationField
    poses: Floats
    noise: OdometryNoise
    lost: int
    runs: int


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibrated class, and its forecasts of K routes in buildings left out.

    Attributes:
        localizer: The class, fitted to all routes, with the reliability of `left_out`.
        left_out: Probability of each route by the fit without its building, shape (K,).
        skill: Brier skill of these, with an interval over buildings.
        ceiling: Brier skill that chance from run to run leaves at most.
    """

    localizer: LocalizerClass
    left_out: Floats
    skill: Interval
    ceiling: float

    @property
    def skill_text(self) -> str:
        """The skill with its interval and, if the drives suffice for one, its ceiling."""
        skill = self.skill
        most = f", at most {self.ceiling:.2f}" if self.ceiling > 0.0 else ""
        return f"{skill.value:.2f} [{skill.low:.2f}, {skill.high:.2f}]{most}"


def calibrate(
    localizer: LocalizerClass,
    routes: Sequence[DrivenRoute],
    rng: np.random.Generator,
    *,
    start_std: ArrayLike,
    folds: int = FOLDS,
    progress: Progress = silent,
) -> Calibration:
    """Fit a class of localizers to drives, and score it on buildings left out.

    Args:
        localizer: Name, title, intervals between updates, `echo_gain`, which is kept, and gains to
            begin with.
        routes: Drives in at least as many buildings as folds.
        rng: Draws the folds and the intervals.
        start_std: Deviations of x, y (metres) and heading (radians) at the start.
        folds: Number of parts in which the buildings are left out.
        progress: Called with the share done.

    Raises:
        InputError: there are too few buildings, or none or all of the robots got lost.
    """
    buildings = np.array([route.building for route in routes])
    names = np.unique(buildings)
    shares = np.array([route.lost / route.runs for route in routes])
    if len(names) < folds:
        raise InputError(
            f"routes are in {len(names)} buildings; give drives in at least {folds}, so that each "
            "part of them can be left out."
        )
    if not 0.0 < shares.mean() < 1.0:
        raise InputError(
            f"of all robots {100.0 * shares.mean():.0f} % got lost; give drives of which some do "
            "and some do not."
        )
    start = np.diag(np.square(np.asarray(start_std, dtype=np.float64)))
    part_of = dict(zip(names.tolist(), rng.permutation(np.arange(len(names)) % folds), strict=True))
    part = np.array([part_of[name] for name in buildings.tolist()])
    left_out = np.empty(len(routes))
    for fold in range(folds):
        other_folds = [route for route, p in zip(routes, part, strict=True) if p != fold]
        fitted = _fitted(localizer, other_folds, start)
        out = part == fold
        left = [route for route, o in zip(routes, out, strict=True) if o]
        left_out[out] = fitted.calibrated(raw_shares(fitted, left, start))
        progress((fold + 1) / (folds + 1))
    fitted = _fitted(localizer, routes, start)
    lost, runs = (np.array([getattr(route, key) for route in routes]) for key in ("lost", "runs"))
    return Calibration(
        replace(fitted, reliability=reliability_of(left_out, lost, runs, buildings)),
        left_out,
        skill_interval(left_out, shares, buildings, rng),
        skill_ceiling(shares, runs),
    )


def raw_shares(localizer: LocalizerClass, routes: Sequence[DrivenRoute], start: Floats) -> Floats:
    """Return lost shares before calibration, shape (K,); `start` is the first covariance."""
    settings = localizer.settings(LOST_POSITION, LOST_HEADING)
    longest = max((len(route.poses) for route in routes), default=0)
    out = np.empty(len(routes))

    def forecast_some(low: int, high: int) -> None:
        covariance, lost = np.empty((longest, 3, 3)), np.empty(longest)
        for i in range(low, high):
            route, count = routes[i], len(routes[i].poses)
            forecast_rows(
                0, 1, np.array([0, count]), route.poses, start, route.field.fields,
                route.field.lattice, route.noise.packed, settings, covariance, lost,
            )  # fmt: skip
            out[i] = lost[count - 1]

    share(forecast_some, len(routes), least=16)
    return out


def brier_skill(forecasts: Floats, shares: Floats, weights: Floats | None = None) -> float:
    """Return Brier's skill of forecasts against the base rate.

    Args:
        forecasts: Probability of each route, shape (K,).
        shares: Share of its runs that got lost, shape (K,).
        weights: How often each route counts, shape (K,); None: once.
    """
    base = np.average(shares, weights=weights)
    scores = shares * (1.0 - forecasts) ** 2 + (1.0 - shares) * forecasts**2
    return float(1.0 - np.average(scores, weights=weights) / (base * (1.0 - base)))


def skill_ceiling(shares: Floats, runs: Ints) -> float:
    """Return the skill of the true probabilities, estimated without bias, runs above 1."""
    base = shares.mean()
    chance = np.mean(shares * (1.0 - shares) * runs / (runs - 1))
    return float(1.0 - chance / (base * (1.0 - base)))


def skill_interval(
    forecasts: Floats, shares: Floats, buildings: NDArray[np.str_], rng: np.random.Generator
) -> Interval:
    """Return Brier's skill with an interval of 95 % over buildings (bootstrap)."""
    drawn = [
        brier_skill(forecasts, shares, weights)
        for weights in np.concatenate(list(grouped_weights(buildings, rng, 1000)))
        if 0.0 < (weights * shares).sum() < weights.sum()
    ]
    value = brier_skill(forecasts, shares)
    return percentiles(value, np.array(drawn), len(np.unique(buildings)))


def _fitted(
    localizer: LocalizerClass, routes: Sequence[DrivenRoute], start: Floats
) -> LocalizerClass:
    """Return the class with the gains and odds that make the drives most likely."""
    shares = np.array([route.lost / route.runs for route in routes])

    def search(begin: LocalizerClass) -> LocalizerClass:
        def of(gains: Floats) -> LocalizerClass:
            gain, turn_gain = np.exp(np.clip(gains, LOW_GAIN, HIGH_GAIN)).tolist()
            return replace(begin, gain=gain, turn_gain=turn_gain)

        def loss(gains: Floats) -> float:
            odds = log_odds(raw_shares(of(gains), routes, start))
            return float(minimize(_loss, np.array([0.0, 0.0]), (odds, shares), jac=True).fun)

        first = np.log([begin.gain, begin.turn_gain])
        simplex = np.vstack([first, first + FIRST_STEP * np.eye(2)])
        options = {"maxfev": EVALUATIONS, "initial_simplex": simplex, "xatol": 0.05, "fatol": 1e-5}
        return of(minimize(loss, first, method="Nelder-Mead", options=options).x)

    fitted = search(replace(localizer, echo_gain=None))
    if any(route.field.has_echoes for route in routes):
        # From far away, the limit by echoes leads to a poor local optimum.
        fitted = search(replace(fitted, echo_gain=localizer.echo_gain))
    odds = log_odds(raw_shares(fitted, routes, start))
    offset, logarithm = minimize(_loss, np.array([0.0, 0.0]), (odds, shares), jac=True).x.tolist()
    return replace(fitted, offset=offset, slope=math.exp(logarithm))


def _loss(line: Floats, odds: Floats, shares: Floats) -> tuple[float, Floats]:
    """Return minus the mean log likelihood of a line through log odds, and its gradient.

    `line` is the offset and the logarithm of the slope.
    """
    slope = math.exp(line[1])
    z = line[0] + slope * odds
    off = 1.0 / (1.0 + np.exp(-z)) - shares
    value = float(np.mean(np.logaddexp(0.0, z) - shares * z))
    return value, np.array([off.mean(), slope * np.mean(off * odds)])
