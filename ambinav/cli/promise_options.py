"""Options of `ambinav plan` on the share of robots that may get lost, and drives that check it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ambinav.cli.checks import conflict
from ambinav.cli.gate import HOLDS
from ambinav.cli.plan_options import CostOptions, ResultOptions, SearchOptions
from ambinav.cli.robot_options import Pose
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.drive.robot import Robot
    from ambinav.forecasting.ensemble import Ensemble
    from ambinav.forecasting.forecast import Forecaster
    from ambinav.forecasting.localizer_class import LocalizerClass
    from ambinav.routes.route import Route
    from ambinav_planners import RoutePlanner


@dataclass(frozen=True, kw_only=True)
class PromiseOptions:
    """Options on the share of robots that may get lost.

    Attributes:
        max_lost (P): Plan the shortest of many routes on which at most this share of the
            robots gets lost, e.g. 0.05, as drives confirm. [default: no limit]
        verify (P): Drive the route until it is known whether fewer than this share of the robots
            get lost; ends with status 3 where that is not so. [default: no drives]
        drives (N): Largest number of drives of a route. [default: 1024]
    """

    PANEL: ClassVar[str] = "Forecast"

    max_lost: float | None = None
    verify: float | None = None
    drives: int | None = None

    @property
    def measures_share(self) -> bool:
        """True if the share of lost robots is asked for."""
        return self.threshold is not None

    @property
    def plans(self) -> bool:
        """True if the route is planned for the share."""
        return self.max_lost is not None

    @property
    def threshold(self) -> float | None:
        """Share that drives are compared with; None: nothing is driven."""
        return self.max_lost if self.verify is None else self.verify

    def check(self, search: SearchOptions, cost: CostOptions, result: ResultOptions) -> None:
        """Check the shares of robots, and refuse options that contradict them.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        for option, share in (("--max-lost", self.max_lost), ("--verify", self.verify)):
            if share is not None and not 0.0 < share < 1.0:
                raise InputError(
                    f"{option} is {share:g}; give a share of robots above 0 and below 1."
                )
            reason = "is of a single route, and --pareto shows all of them"
            conflict(option, share is not None and result.pareto, reason)
        if not self.measures_share:
            conflict("--drives", self.drives is not None, "is for --verify and --max-lost")
        if self.drives is not None and self.drives < 1:
            raise InputError(f"--drives is {self.drives}; give a number of at least 1.")
        if self.max_lost is not None:
            conflict("--verify", self.verify is not None, "is what --max-lost does by itself")
            conflict("--max-lost", search.has_belief, "is not for the planners of beliefs")
            conflict("--weight", cost.weight != CostOptions.weight, "is chosen by --max-lost")

    def check_trust(self, localizer: LocalizerClass, trust: bool) -> None:
        """Refuse drives that start a program, unless it is trusted.

        Raises:
            InputError: the class is of one, and it is not.
        """
        if self.measures_share and localizer.runs_command and not trust:
            raise InputError(
                f"--localizer: drives of {localizer.title} would run with your rights; if you "
                "trust it, add --trust."
            )

    def plan(
        self,
        robot: RoutePlanner,
        start: Pose,
        goal: Pose,
        forecaster: Forecaster,
        search: SearchOptions,
    ) -> tuple[Route, Ensemble]:
        """Plan the route that keeps the promise; return it with its drives."""
        from ambinav_planners.promise import RUNS, route_within

        assert self.max_lost is not None
        promise = route_within(
            robot, start, goal, forecaster, self.max_lost,
            runner=forecaster.runner(_driven_robot(robot)), runs=self.drives or RUNS,
            **search.arguments,
        )  # fmt: skip
        assert promise.driven is not None
        return promise.route, promise.driven

    def drive(
        self,
        robot: RoutePlanner,
        routes: Mapping[str, Route],
        forecaster: Forecaster,
        seed: int | None,
    ) -> dict[str, Ensemble]:
        """Drive routes until it is known on which side of the threshold each is."""
        import numpy as np

        from ambinav_planners.promise import RUNS

        if not routes:
            return {}
        rng, runner = np.random.default_rng(seed), forecaster.runner(_driven_robot(robot))
        return {
            name: runner.drive(route, rng, self.drives or RUNS, until=self.threshold)
            for name, route in routes.items()
        }

    def status(self, driven: Ensemble) -> int:
        """Return the exit status of the command."""
        return HOLDS if self.verify is not None and driven.side != "below" else 0


def _driven_robot(robot: RoutePlanner) -> Robot:
    """Return a disc that fits where the planned robot fits."""
    from ambinav.drive.robot import Robot

    return Robot(radius=robot.checker.footprint.inner)
