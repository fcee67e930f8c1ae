"""The shortest route on which at most a given share of robots gets lost.

The candidates are the cheapest routes for many weights of the map's layer (`fronts.pareto`), which
trade length for ambiguity; each is forecast, and of those that keep the promise the shortest is
taken. A route that no weight makes the cheapest is not among them: that none keeps the promise is
no proof that none exists.
"""

from __future__ import annotations

from collections.abc import Sequence

from ambinav.config import as_number
from ambinav.forecasting.forecast import Forecast, Forecaster
from ambinav.routes.route import Route
from ambinav.runtime.errors import InputError
from ambinav_planners.fronts import pareto
from ambinav_planners.planning import RoutePlanner

WEIGHTS = (0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 8.0, 12.0, 20.0, 40.0, 80.0)
"""Weights of the candidates."""


class PromiseError(InputError):
    """No candidate keeps the promise.

    Attributes:
        route: The candidate on which the fewest robots get lost.
        forecast: Its forecast.
    """

    def __init__(self, message: str, route: Route, forecast: Forecast) -> None:
        super().__init__(message)
        self.route, self.forecast = route, forecast


def route_within(
    robot: RoutePlanner,
    start: Sequence[float],
    goal: Sequence[float],
    forecaster: Forecaster,
    max_lost: float,
    *,
    weights: Sequence[float] = WEIGHTS,
    planner_name: str | None = None,
    seconds: float = 1.0,
    iterations: int | None = None,
    seed: int | None = None,
    improved: bool = True,
) -> tuple[Route, Forecast]:
    """Plan the shortest route on which at most a share of the robots gets lost.

    Args:
        robot: The robot and its cost service.
        start: x, y and, if it matters, theta.
        goal: As `start`.
        forecaster: Forecaster of the same map.
        max_lost: Largest share, above 0 and below 1.
        weights: Weights of the candidates, at least two.
        planner_name: See `RoutePlanner.plan`.
        seconds: Time for the graph, or for each weight.
        iterations: As in `RoutePlanner.plan`.
        seed: As in `RoutePlanner.plan`.
        improved: As in `RoutePlanner.plan`.

    Returns:
        The route and its forecast.

    Raises:
        PromiseError: no candidate keeps the promise.
        InputError: `max_lost` is no share, or what `pareto` refuses.
    """
    if not 0.0 < as_number(max_lost, "max_lost") < 1.0:
        raise InputError(f"max_lost is {max_lost:g}; give a share of robots above 0 and below 1.")
    front = pareto(
        robot, start, goal,
        weights=weights, planner_name=planner_name, seconds=seconds, iterations=iterations,
        seed=seed, improved=improved,
    )  # fmt: skip
    routes = [point.route for point in front.points]
    lost = forecaster.lost_probabilities(routes)
    kept = [route for route, share in zip(routes, lost.tolist(), strict=True) if share <= max_lost]
    if kept:
        best = min(kept, key=lambda route: route.length)
        return best, forecaster(best)
    least = routes[int(lost.argmin())]
    forecast = forecaster(least)
    raise PromiseError(
        f"none of {len(routes)} routes keeps to {100.0 * max_lost:g} % of robots lost; on the "
        f"best, {least.length:.1f} m at weight {least.weight:g}, {100.0 * lost.min():.1f} % get "
        "lost; allow more, or choose another scanner or odometry.",
        least,
        forecast,
    )
