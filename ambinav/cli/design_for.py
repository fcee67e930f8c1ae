"""`ambinav design for`: the cheapest changes that meet a requirement."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.cli import options
from ambinav.cli.checks import conflict
from ambinav.cli.design_place import UNUSED_LAYERS, SpacePositionOptions
from ambinav.cli.forecast_options import ForecastOptions
from ambinav.cli.gate import HOLDS
from ambinav.cli.limits import not_negative
from ambinav.cli.map_options import BuildingOptions, MapOptions, ReachOptions
from ambinav.cli.printing import finish, show, table
from ambinav.cli.region_options import KeepOut, keep_out_zones
from ambinav.cli.running import check_report, progress_bars, reporting
from ambinav.cli.space_options import SpaceOptions
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from ambinav.routes.trips import Trip
    from ambinav.studies.design.requirement.costs import Allowed, Costs
    from ambinav.studies.design.requirement.document import Document
    from ambinav.studies.design.requirement.requirement import Requirement

FOR_LOST = 'is for a requirement on lost robots, such as "lost < 5 %"'


@dataclass(frozen=True)
class Request:
    """A checked requirement: what must hold, what may change, and what that costs."""

    requirement: Requirement | None
    allowed: Allowed
    costs: Costs
    trips: tuple[Trip, ...] | None
    keep_out: BaseGeometry | None


@dataclass(frozen=True, kw_only=True)
class RequirementOptions:
    """Options on the allowed changes and their costs.

    Attributes:
        may (CHANGES): Allowed changes: posts=N, panels=N, tags=N (at most), scanner, mount,
            second-scanner; separated by commas, or repeatable.
        cost (FILE): What the changes cost (.yaml: post, panel, tag, mount, scanner).
        budget (AMOUNT): Largest cost. [default: no limit]
        places (FILE): Named places and trips between them (.yaml: places, trips), for "lost < 5 %".
    """

    PANEL: ClassVar[str] = "Changes"

    may: list[str]
    cost: Path
    budget: Annotated[float | None, not_negative("500", "an amount")] = None
    places: Path | None = None
    keep_out: KeepOut = None

    def check(
        self, required: str | None, obstacles: SpacePositionOptions, forecasts: ForecastOptions
    ) -> Request:
        """Check the options, and read the files, before the map is made.

        Args:
            required: What must hold; None: it is not given.
            obstacles: Options on new obstacles.
            forecasts: Options on forecasts of lost robots.

        Raises:
            InputError: a value, a file or a combination of options cannot be used.
        """
        from ambinav.routes.trips import EXAMPLE, read_trips
        from ambinav.studies.design.requirement.costs import Allowed, read_costs
        from ambinav.studies.design.requirement.requirement import Requirement

        if required is None and self.budget is None:
            raise InputError(
                'REQUIREMENT: none is given; write one such as "bad < 2 %", or --budget.'
            )
        parsed = None if required is None else Requirement.parse(required)
        is_lost = parsed is not None and parsed.most_lost is not None
        if is_lost and self.places is None:
            raise InputError(
                f'--places: "{parsed}" is about trips between places; give a file with them, e.g. '
                f"`{EXAMPLE}`."
            )
        if not is_lost:
            conflict("--places", self.places is not None, FOR_LOST)
            for option in forecasts.given_options:
                conflict(option, True, FOR_LOST)
        forecasts.check()
        forecasts.check_no_program()
        trips = None if self.places is None else read_trips(self.places)
        allowed = Allowed.parse(",".join(self.may))
        costs = read_costs(self.cost)
        allowed.check(costs, str(self.cost))
        obstacles.check_used(tuple(allowed.most))
        if not allowed.most:
            conflict("--keep-out", self.keep_out is not None, "is about new obstacles")
        for kind in allowed.most:
            obstacles.rules_of(kind)
        return Request(parsed, allowed, costs, trips, keep_out_zones(self.keep_out))


@options.documented
def requirement(
    map_file: options.MapFile,
    required: Annotated[str | None, typer.Argument()] = None,
    *,
    scanner: options.Scanner,
    changes: RequirementOptions,
    output: options.ReportFolder = None,
    obstacles: SpacePositionOptions,
    building: BuildingOptions,
    map_options: MapOptions,
    space: SpaceOptions,
    robot: ReachOptions,
    forecasts: ForecastOptions,
    pictures: options.Pictures = "png",
    as_json: options.AsJson = False,
    quiet: options.Quiet = False,
) -> None:
    """Find the cheapest changes that meet a requirement on bad floor or on lost robots.

    Posts, panels and tags are searched greedily, with the present scanner and with each other one
    that is allowed; every step is checked by a full map. The result is the cheapest found. With
    "lost < 5 %" at most so many robots may get lost on each trip between the places of --places,
    by the forecast and in drives. Ends with status 3 if the requirement cannot be met, and reports
    the best that can be done.

    Example: `ambinav design for office.yaml "bad < 2 %" -s turtlebot3-lds --may posts=8,scanner
    --cost costs.yaml -o changes`

    Parameters:
        required (REQUIREMENT): What must hold, e.g. "bad < 2 %", "open area < 10 m2" or "lost < 5
            %"; without it --budget says how much the best may cost.
    """
    with reporting():
        from ambinav.studies.design.requirement.document import document
        from ambinav.studies.design.requirement.report import STUDY, write_report
        from ambinav.studies.design.requirement.study import meet_requirement
        from ambinav.studies.design.requirement.trip_forecasts import TripForecaster

        space.check()
        request = changes.check(required, obstacles, forecasts)
        conflict("--layers", map_options.layers is not None, UNUSED_LAYERS)
        check_report(STUDY, output, pictures)
        environment, chosen = map_options.load(
            map_file, scanner, building, space, robot.robot_radius or 0.0
        )
        reach = robot.reach(environment, chosen)
        forecaster = None
        if request.trips is not None:
            forecaster = TripForecaster(
                environment, reach, request.trips, forecasts.forecaster, str(changes.places)
            )
        with progress_bars(as_json or quiet) as bars:
            solution = meet_requirement(
                environment,
                chosen,
                lambda env, mounted: map_options.build(
                    env, mounted, bars(f"map: {mounted.name}"), quiet=env is not environment
                ),
                request.allowed,
                request.costs,
                obstacles.rules_of,
                reach,
                requirement=request.requirement,
                budget=changes.budget,
                keep_out=request.keep_out,
                trips=forecaster,
                source=str(changes.cost),
                stages=bars,
            )
            if output is None:
                report = document(solution)
            else:
                report = write_report(solution, output, bars("report"), pictures)
        finish(report, _show, STUDY.page(output), as_json=as_json, quiet=quiet)
        if report.met is False:
            raise typer.Exit(HOLDS)


def _show(report: Document) -> None:
    from ambinav.studies.design.requirement.document import money

    show(report.summary, *report.remarks)
    if report.steps:
        lost = ("worst trip\nlost (%)",) if report.trips else ()
        columns = ("no.", "change", "x (m)", "y (m)", "cost\nso far", *lost, "bad floor\nm²", "%")
        rows = [
            (
                str(step.number),
                step.text,
                *("" if value is None else f"{value:.2f}" for value in (step.x_m, step.y_m)),
                money(step.cost_so_far),
                *(f"{step.after.value:.1f}" for _ in lost),
                f"{step.after.bad_area_m2:,.1f}",
                f"{100.0 * step.after.bad_share:.1f}",
            )
            for step in report.steps
        ]
        show("", table(columns, rows, left=("change",), no_wrap=("no.",)))
