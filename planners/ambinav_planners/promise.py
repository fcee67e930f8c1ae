"""The shortest route on which at most a given share of robots gets lost.

Candidates are the shortest route and, where that does not do, the cheapest ones for many weights of
the map's layer (`fronts.pareto`), which trade length for ambiguity, and for a disc in r2 those of a
search over place and belief (`belief.lost_search`), which knows that a robot that has just seen
where it is can cross what would lose another. Each is forecast; then, the shortest first, those
that may keep to the share are driven by the localizer itself, many times, until it is known on
which side of the share they are. A search finds what the forecast is too sure of, so it is also
asked for fewer lost robots than are allowed. That no candidate is confirmed is no proof that no
route keeps the promise.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from types import NoneType

import numpy as np

from ambinav.config import as_count, as_number, check_kind
from ambinav.forecasting.ensemble import Ensemble, EnsembleRunner, least_shown
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav_planners.belief.lost_search import search_within
from ambinav_planners.belief.lost_shortcuts import shortened
from ambinav_planners.fronts import pareto
from ambinav_planners.planning import RoutePlanner, planner_name_or_default
from ambinav_planners.problem import Problem
from ambinav_planners.reference import reference_graph

WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 12.0, 20.0, 40.0, 80.0)
"""Weights of the candidates that are not the shortest."""
SEARCH = "search of beliefs"
"""Planner of the other candidates, in their records."""
RUNS = 1024
"""Largest number of drives of a candidate."""
SEARCHED_SHARES = (1.0, 0.4, 0.15, 0.05)
"""Shares of lost robots that are searched for, as parts of the allowed one."""
LATTICE_PART = 0.75
"""Part of a searched share that the path over the lattice may use; its shortcuts may use all."""
MOST_FORECAST = 0.5
"""Largest forecast share of a candidate that is driven."""
NEXT_FORECAST = 0.8
"""Largest forecast share of a candidate as a part of that of one that was not confirmed."""
DUPLICATE = 1e-3
"""Candidates are the same if lengths (metres) and forecasts differ by less."""


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
        runs: Largest number of drives of a candidate. One of which it is not known then whether it
            keeps the promise does not count.
        weights: Weights of the other candidates, at least two.
        planner_name: See `RoutePlanner.plan`.
        seconds: Time for the graph, or for each weight.
        iterations: As in `RoutePlanner.plan`.
        seed: As in `RoutePlanner.plan`.
        improved: As in `RoutePlanner.plan`.

    Raises:
        PromiseError: no candidate keeps the promise.
        InputError: `max_lost` is no share, or one that `runs` drives cannot confirm, or what
            `pareto` or `EnsembleRunner.drive` refuses.
    """
    if not 0.0 < as_number(max_lost, "max_lost") < 1.0:
        raise InputError(f"max_lost is {max_lost:g}; give a share of robots above 0 and below 1.")
    if runner is not None:
        _check_runs(runs, max_lost)
    check_kind(robot, RoutePlanner, "robot")
    check_kind(forecaster, Forecaster, "forecaster")
    check_kind(runner, (EnsembleRunner, NoneType), "runner")
    rng = np.random.default_rng(seed) if rng is None else rng
    trials = _Trials(forecaster, max_lost, runner, rng, runs)
    chosen = planner_name_or_default(
        planner_name, robot.checker, iterations, keeps_lanes=robot.one_way is not None
    )
    if chosen == "reference":
        # Most often the shortest route will do, and its search alone is quick.
        shortest = robot.plan(start, goal, planner_name=chosen, weight=0.0, improved=improved)
        promise = trials.promise_of(shortest, float(forecaster.lost_probabilities([shortest])[0]))
        if promise is not None:
            return promise
    front = pareto(
        robot, start, goal,
        weights=weights, planner_name=chosen, seconds=seconds, iterations=iterations,
        seed=seed, improved=improved,
    )  # fmt: skip
    routes = [point.route for point in front.points]
    problem = robot.problem(start, goal, 0.0)
    # A limit on bad metres in a row, and one-way lanes, are none of the search's.
    if problem.limit is None and problem.one_way is None and chosen == "reference":
        routes += _searched(problem, routes, forecaster, max_lost)
    candidates = _distinct(problem, routes, forecaster)
    likeliest = min(candidates, key=lambda candidate: candidate[1])[0]
    for route, share in candidates:
        promise = trials.promise_of(route, share, surely=route is likeliest)
        if promise is not None:
            return promise
    best = min(trials.driven, key=lambda promise: promise.share, default=None)
    if best is None:
        best = Promise(likeliest, forecaster(likeliest), None)
    raise _none_keeps(max_lost, len(candidates), best)


def _check_runs(runs: int, max_lost: float) -> None:
    """Refuse a share too small for `runs` drives to confirm, even where no robot gets lost."""
    least = least_shown(as_count(runs, "runs"))
    if max_lost <= least:
        # Of no losses in n runs Wilson's interval ends at z^2 / (n + z^2).
        needed = math.floor(least * runs / (1.0 - least) * (1.0 / max_lost - 1.0)) + 1
        raise InputError(
            f"max_lost is {max_lost:g}, but {runs} drives confirm no share below {least:.2g}, even "
            f"where no robot gets lost; allow more, or drive {needed} (--drives, in Python runs)."
        )


class _Trials:
    """Finds of one candidate after the other, the shortest first, whether it keeps the promise.

    Attributes:
        driven: Those that were driven, and do not.
    """

    def __init__(
        self,
        forecaster: Forecaster,
        max_lost: float,
        runner: EnsembleRunner | None,
        rng: np.random.Generator,
        runs: int,
    ) -> None:
        self._forecaster, self._max_lost = forecaster, max_lost
        self._runner, self._rng, self._runs = runner, rng, runs
        self._max_share = MOST_FORECAST
        self.driven: list[Promise] = []

    def promise_of(self, route: Route, share: float, *, surely: bool = False) -> Promise | None:
        """Return the promise of a route with this forecast; None if it is not known to keep it.

        A route whose forecast leaves it no chance is driven only where it is asked for `surely`,
        and none is driven twice.
        """
        if self._runner is None:
            within = share <= self._max_lost
            return Promise(route, self._forecaster(route), None) if within else None
        before = ((earlier.route, earlier.forecast.lost_probability) for earlier in self.driven)
        if (share > self._max_share and not surely) or _is_among((route, share), before):
            return None
        driven = self._runner.drive(route, self._rng, self._runs, until=self._max_lost)
        promise = Promise(route, self._forecaster(route), driven)
        if driven.side == "below":
            return promise
        self.driven.append(promise)
        part = max(NEXT_FORECAST * share, SEARCHED_SHARES[-1] * self._max_lost)
        self._max_share = min(self._max_share, part)
        return None


def _searched(
    problem: Problem, routes: Sequence[Route], forecaster: Forecaster, max_lost: float
) -> list[Route]:
    """Return routes of the search over place and belief that are shorter than the given ones.

    Shorter than those that are forecast to keep to the same share.
    """
    started = time.perf_counter()
    graph = reference_graph(problem)
    forecasts = forecaster.lost_probabilities(routes)
    searched = []
    for part in SEARCHED_SHARES:
        share = part * max_lost
        lengths = [
            _metres(problem, route)
            for route, lost in zip(routes, forecasts.tolist(), strict=True)
            if lost <= share
        ]
        path = search_within(
            graph, forecaster, len(graph.poses) - 2, len(graph.poses) - 1, LATTICE_PART * share,
            longest=min(lengths, default=math.inf),
        )  # fmt: skip
        if path is None:
            continue
        points = shortened(
            graph.poses[path.nodes, :2], problem.checker, forecaster, share, problem.service
        )
        poses = problem.steering.oriented(np.column_stack([points, np.zeros(len(points))]))
        seconds = time.perf_counter() - started
        searched.append(
            evaluate_route(
                problem.service, poses, problem.steering, planner=SEARCH, seconds=seconds,
                first_seconds=seconds,
            )
        )  # fmt: skip
    return searched


def _metres(problem: Problem, route: Route) -> float:
    """Return the length of a route, with the metres that the cost adds; the weight is 0."""
    if problem.service.plain is None:
        return route.length
    return problem.service.route_cost(route.poses, problem.steering)


def _distinct(
    problem: Problem, routes: Sequence[Route], forecaster: Forecaster
) -> list[tuple[Route, float]]:
    """Return different routes with the shares forecast to get lost, the shortest first."""
    shares = forecaster.lost_probabilities(routes).tolist()
    distinct: list[tuple[Route, float]] = []
    pairs = zip(routes, shares, strict=True)
    for pair in sorted(pairs, key=lambda pair: (_metres(problem, pair[0]), pair[1])):
        if not _is_among(pair, distinct):
            distinct.append(pair)
    return distinct


def _is_among(pair: tuple[Route, float], pairs: Iterable[tuple[Route, float]]) -> bool:
    """Return whether a route with its forecast share is the same as another."""
    return any(
        abs(pair[0].length - route.length) < DUPLICATE and abs(pair[1] - share) < DUPLICATE
        for route, share in pairs
    )


def _none_keeps(max_lost: float, count: int, best: Promise) -> PromiseError:
    share = 100.0 * best.share
    which = f"on the best, {best.route.length:.1f} m long,"
    if best.driven is None:
        verb, how = "keeps", f"{which} {share:.1f} % are forecast to get lost"
    else:
        # On some the drives were too few to say.
        verb = "keeps" if best.driven.side == "above" else "is shown to keep"
        low, high = 100.0 * best.driven.probability.low, 100.0 * best.driven.probability.high
        how = (
            f"{which} {share:.1f} % (95 % interval {low:.1f} to {high:.1f}) of "
            f"{len(best.driven)} driven robots get lost"
        )
    return PromiseError(
        f"none of {count} routes {verb} to {100.0 * max_lost:g} % of robots lost; {how}; allow "
        "more, or choose another scanner or odometry.",
        best,
    )
