"""The shortest route on which at most a given share of robots gets lost.

The candidates are the cheapest routes for many weights of the map's layer (`fronts.pareto`), which
trade length for ambiguity. Each is forecast; then, the shortest first, those that are not hopeless
are driven by the localizer itself, many times, until it is known on which side of the share they
are. A route that no weight makes the cheapest is not among them: that none keeps the promise is no
proof that none exists.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ambinav.config import as_number
from ambinav.forecasting.ensemble import Ensemble, EnsembleRunner
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav_planners.fronts import pareto
from ambinav_planners.planning import RoutePlanner

WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 12.0, 20.0, 40.0, 80.0)
"""Weights of the candidates."""
RUNS = 512
"""Largest number of drives of a candidate."""
HOPELESS = 0.5
"""Routes are not driven on which more than this share of robots is forecast to get lost."""
SAME = 1e-3
"""Candidates whose lengths and forecasts differ by less, metres and shares, are driven once."""


@dataclass(frozen=True, eq=False)
class Promise:
    """A route that keeps to a share of lost robots, with what tells so.

    Attributes:
        route: The route.
        forecast: Its forecast.
        driven: Its drives; None where nothing was to be driven.
    """

    route: Route
    forecast: Forecast
    driven: Ensemble | None

    @property
    def share(self) -> float:
        """Share of robots that got lost in the drives, or else in the forecast."""
        if self.driven is None:
            return self.forecast.lost_probability
        return self.driven.probability.value


class PromiseError(InputError):
    """No candidate keeps the promise.

    Attributes:
        best: The candidate on which the fewest robots get lost, as far as is known.
    """

    def __init__(self, message: str, best: Promise) -> None:
        super().__init__(message)
        self.best = best


def route_within(
    robot: RoutePlanner,
    start: Sequence[float],
    goal: Sequence[float],
    forecaster: Forecaster,
    max_lost: float,
    *,
    runner: EnsembleRunner | None = None,
    rng: np.random.Generator | None = None,
    runs: int = RUNS,
    weights: Sequence[float] = WEIGHTS,
    planner_name: str | None = None,
    seconds: float = 1.0,
    iterations: int | None = None,
    seed: int | None = None,
    improved: bool = True,
) -> Promise:
    """Plan the shortest route on which at most a share of the robots gets lost.

    Args:
        robot: The robot and its cost service.
        start: x, y and, if it matters, theta.
        goal: As `start`.
        forecaster: Forecaster of the same map.
        max_lost: Largest share, above 0 and below 1.
        runner: Drives the candidates (`forecaster.runner()`); None: the forecasts are believed.
        rng: Randomness of the drives; None: seeded by `seed`.
        runs: Largest number of drives of a candidate. One of which it is not known then on which
            side it is counts by the share of its drives.
        weights: Weights of the candidates, at least two.
        planner_name: See `RoutePlanner.plan`.
        seconds: Time for the graph, or for each weight.
        iterations: As in `RoutePlanner.plan`.
        seed: As in `RoutePlanner.plan`.
        improved: As in `RoutePlanner.plan`.

    Raises:
        PromiseError: no candidate keeps the promise.
        InputError: `max_lost` is no share, or what `pareto` or `EnsembleRunner.drive` refuses.
    """
    if not 0.0 < as_number(max_lost, "max_lost") < 1.0:
        raise InputError(f"max_lost is {max_lost:g}; give a share of robots above 0 and below 1.")
    front = pareto(
        robot, start, goal,
        weights=weights, planner_name=planner_name, seconds=seconds, iterations=iterations,
        seed=seed, improved=improved,
    )  # fmt: skip
    candidates = _distinct([point.route for point in front.points], forecaster)
    likeliest = min(candidates, key=lambda candidate: candidate[1])[0]
    if runner is None:
        for route, share in candidates:
            if share <= max_lost:
                return Promise(route, forecaster(route), None)
        raise _none_keeps(
            max_lost, len(candidates), Promise(likeliest, forecaster(likeliest), None)
        )
    rng = np.random.default_rng(seed) if rng is None else rng
    tried: list[Promise] = []
    for route, share in candidates:
        if share <= HOPELESS or route is likeliest:
            driven = runner.drive(route, rng, runs, until=max_lost)
            tried.append(Promise(route, forecaster(route), driven))
            if driven.side != "above" and driven.probability.value <= max_lost:
                return tried[-1]
    best = min(tried, key=lambda promise: promise.share)
    raise _none_keeps(max_lost, len(candidates), best)


def _distinct(routes: Sequence[Route], forecaster: Forecaster) -> list[tuple[Route, float]]:
    """Return different routes with the shares forecast to get lost, the shortest first."""
    shares = forecaster.lost_probabilities(routes).tolist()
    distinct: list[tuple[Route, float]] = []
    pairs = zip(routes, shares, strict=True)
    for route, share in sorted(pairs, key=lambda pair: (pair[0].length, pair[1])):
        same = (
            abs(route.length - other.length) < SAME and abs(share - others) < SAME
            for other, others in distinct
        )
        if not any(same):
            distinct.append((route, share))
    return distinct


def _none_keeps(max_lost: float, count: int, best: Promise) -> PromiseError:
    how = "are forecast to" if best.driven is None else f"of {len(best.driven)} driven robots"
    return PromiseError(
        f"none of {count} routes keeps to {100.0 * max_lost:g} % of robots lost; on the best, "
        f"{best.route.length:.1f} m at weight {best.route.weight:g}, {100.0 * best.share:.1f} % "
        f"{how} get lost; allow more, or choose another scanner or odometry.",
        best,
    )
