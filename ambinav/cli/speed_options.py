"""Options of `ambinav plan` on the robot's speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, ClassVar, Final

from ambinav.cli.checks import conflict
from ambinav.cli.limits import above_zero, not_negative
from ambinav.cli.plan_options import CostOptions, LimitOptions, ResultOptions, SearchOptions
from ambinav.cli.promise_options import PromiseOptions
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.cli.forecast_options import ForecastOptions
    from ambinav.forecasting.braking import BrakingRule
    from ambinav.forecasting.forecast import Forecaster
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.routes.clock import SpeedLimits
    from ambinav.routes.route import Route
    from ambinav.service.service import AmbiguityService
    from ambinav_planners import MissionRoute, RoutePlanner

TIME: Final = "time"


@dataclass(frozen=True, kw_only=True)
class SpeedOptions:
    """Options on the limits that stamps and duration of a route keep to.

    Attributes:
        max_speed (M/S): Maximum speed, metres per second. [default: 0.5]
        acceleration: Maximum acceleration and deceleration, metres per second squared. [default:
            2.5]
        max_turn_rate: Maximum turn rate, radians per second. [default: 2.0]
        lateral_acceleration: Maximum acceleration across the path in bends, metres per second
            squared. [default: no limit]
        stop_sigmas (K): Bound the speed so that the robot can stop before walls if its forecast
            position is up to K standard deviations off, e.g. 3. [default: no bound]
        creep_speed: Speed where there is no room to stop, metres per second; for --stop-sigmas.
            [default: 0.1]
        minimise (cost|time): Plan for the least cost, or for the least time: a metre then takes as
            long as --stop-sigmas allows there (default 3), for the error that a robot comes to on
            such floor, or for none, whichever gives the faster route. [default: cost]
    """

    PANEL: ClassVar[str] = "Speed"

    max_speed: Annotated[float | None, above_zero("0.5", "metres per second")] = None
    acceleration: Annotated[float | None, above_zero("0.5", "m/s^2")] = None
    max_turn_rate: Annotated[float | None, above_zero("1", "radians per second")] = None
    lateral_acceleration: Annotated[float | None, above_zero("0.5", "m/s^2")] = None
    stop_sigmas: Annotated[float | None, not_negative("3", "a number")] = None
    creep_speed: Annotated[float | None, above_zero("0.1", "metres per second")] = None
    minimise: str = "cost"

    @property
    def bounds_speed(self) -> bool:
        """True if the forecast error bounds the speed."""
        return self.stop_sigmas is not None or self.least_time

    @property
    def least_time(self) -> bool:
        """True if the time is minimised, not the cost."""
        return self.minimise == TIME

    def check(
        self,
        search: SearchOptions,
        cost: CostOptions,
        promise: PromiseOptions,
        result: ResultOptions,
        limits: LimitOptions,
    ) -> None:
        """Refuse a creep speed above the others, and options that contradict minimum time.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        if self.minimise not in ("cost", TIME):
            raise InputError(f"--minimise: {self.minimise!r} is neither cost nor time; give one.")
        for option, is_given in (
            ("--weight", cost.weight != CostOptions.weight),
            ("--layer", cost.layer is not None),
            ("--clearance-weight", cost.clearance_weight != 0.0),
            ("--prefer", cost.prefer is not None),
            ("--max-lost", promise.plans),
            ("--pareto", result.pareto),
            ("--max-bad-metres", limits.max_bad_metres is not None),
            ("--planner belief", search.has_belief),
        ):
            conflict(option, is_given and self.least_time, "is not for --minimise time")
        from ambinav.routes.clock import SpeedLimits

        fastest = SpeedLimits().max_speed if self.max_speed is None else self.max_speed
        if self.creep_speed is not None and self.creep_speed > fastest:
            raise InputError(
                f"--creep-speed is {self.creep_speed:g}, more than --max-speed, {fastest:g} m/s; "
                "give less."
            )
        if not self.bounds_speed:
            conflict("--creep-speed", self.creep_speed is not None, "is for --stop-sigmas")

    @property
    def _sigmas(self) -> float:
        from ambinav.forecasting.braking import BrakingRule

        return BrakingRule.sigmas if self.stop_sigmas is None else self.stop_sigmas

    @property
    def _creep(self) -> float:
        from ambinav.forecasting.braking import BrakingRule

        return BrakingRule.creep if self.creep_speed is None else self.creep_speed

    @property
    def limits(self) -> SpeedLimits:
        """Limits of the robot's speed."""
        from ambinav.routes.clock import SpeedLimits

        names = ("max_speed", "acceleration", "max_turn_rate", "lateral_acceleration")
        values = {name: getattr(self, name) for name in names}
        return SpeedLimits(**{name: value for name, value in values.items() if value is not None})

    def rule(self, radius: float) -> BrakingRule:
        """Return the rule by which the error bounds the speed of a robot."""
        from ambinav.forecasting.braking import BrakingRule

        return BrakingRule(
            radius=radius, acceleration=self.limits.acceleration, sigmas=self._sigmas,
            creep=self._creep,
        )  # fmt: skip

    def services(
        self, amap: AmbiguityMap, radius: float, forecast: ForecastOptions
    ) -> list[AmbiguityService]:
        """Return services whose costs are seconds times the maximum speed.

        The first is for the error of each place, the other one for none: the error of a route is
        not that of its places, and either may lead to the faster route.
        """
        from ambinav.forecasting.slowness import LAYER, with_slowness
        from ambinav.service.service import AmbiguityService

        rule = self.rule(radius)
        models = {
            "odometry": forecast.odometry or ODOMETRY, "localizer": forecast.localizer or LOCALIZER
        }  # fmt: skip
        return [
            AmbiguityService(
                with_slowness(amap, braking, self.limits.max_speed, **models), LAYER, weight=1.0
            )
            for braking in (rule, replace(rule, sigmas=0.0))
        ]

    def fastest(
        self, plans: Sequence[MissionRoute], robot: RoutePlanner, forecaster: Forecaster
    ) -> int:
        """Return which route takes the least time under the error that is forecast along it."""
        from ambinav.routes.evaluate import joints

        routes = {str(k): plan.route for k, plan in enumerate(plans)}
        stops = {str(k): joints(plan.legs) for k, plan in enumerate(plans)}
        timed, _ = self.timed(routes, robot, forecaster, stops)
        seconds = []
        for route in timed.values():
            assert route.duration is not None  # it has just been timed
            seconds.append(route.duration)
        return seconds.index(min(seconds))

    def timed(
        self,
        routes: Mapping[str, Route],
        robot: RoutePlanner,
        forecaster: Forecaster | None,
        stops: Mapping[str, Sequence[int]] | None = None,
    ) -> tuple[dict[str, Route], dict[str, float]]:
        """Return routes with stamps, and of each the metres with no room to stop, if that counts.

        Args:
            routes: The routes by name.
            robot: The planner of the robot.
            forecaster: Forecasts the error; needed if it bounds the speed.
            stops: Indices of poses at which the robot stops, by name.
        """
        limits, rule, bounds = self.limits, None, {}
        if self.bounds_speed and forecaster is not None:
            rule = self.rule(robot.checker.footprint.outer)
            for name, route in routes.items():
                bounds[name] = rule.bound(forecaster.map, forecaster(route))
        halts = stops or {}
        return {
            name: route.timed(limits, stops=halts.get(name, ()), bound=bounds.get(name))
            for name, route in routes.items()
        }, {name: rule.creep_metres(bound) for name, bound in bounds.items() if rule}

    def minimised(self, routes: Mapping[str, Route], service: AmbiguityService) -> dict[str, float]:
        """Return the minimised seconds of each route; empty unless time is minimised."""
        fastest = self.limits.max_speed
        return {
            name: service.route_cost(route.poses, route.steering) / fastest
            for name, route in routes.items()
            if self.least_time
        }

    def lines(self, creep: Mapping[str, float]) -> list[str]:
        """Return the printed lines about routes that leave no room to stop."""
        return [
            f"{name}: {metres:.1f} m leave no room to stop at {self._sigmas:g} standard "
            f"deviations, driven at {self._creep:g} m/s"
            for name, metres in creep.items()
            if metres > 0.0
        ]
