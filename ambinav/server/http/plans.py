"""Planning routes: one path, or the front of length and exposure."""

from __future__ import annotations

import dataclasses
from typing import Any, Literal

from fastapi import APIRouter, Request
from pydantic import BaseModel, Field
from starlette.responses import Response

from ambinav.config import nearest
from ambinav.drive.odometries import ODOMETRIES
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.forecasting.localizer_class import localizer_classes
from ambinav.server.guard import client_of
from ambinav.server.http.context import context_of
from ambinav.server.http.models import XY, Column, Strict, as_json
from ambinav.server.jobs.plan_archive import PlanJob
from ambinav.server.jobs.plan_jobs import while_connected
from ambinav.server.jobs.workers import PlanTask
from ambinav.server.problems import Problem, answers
from ambinav.server.served import DEFAULT_WEIGHT, ServedMap

router = APIRouter(prefix="/v1/maps/{id}", tags=["planning"])
kept = APIRouter(prefix="/v1/plans", tags=["planning"])

_ANSWERS = answers(400, 401, 404, 408, 413, 422, 429, 503, 504)


class _StartAndGoal(Strict):
    """Start and goal of a route, and the robot."""

    start: XY = Field(description="x, y and optionally theta; metres, radians")
    goal: XY = Field(description="x, y and optionally theta; metres, radians")
    planner: str | None = Field(
        None, description="Name of a planner, as `ambinav plan --list-planners` lists them"
    )
    layer: str | None = Field(None, description="Layer; null: the map's own choice")
    time_s: float = Field(1.0, gt=0.0, description="Time for planning, seconds")
    seed: int | None = Field(
        None, ge=0, lt=2**32 - 1, description="Seed of the planner's random numbers"
    )
    radius: float | None = Field(
        None, gt=0.0, lt=100.0, description="Radius of the robot's disc, metres; null: 0.2"
    )
    odometry: str = Field(
        ODOMETRY, description="Odometry of the forecast, of `forecast.odometries` of the map"
    )
    localizer: str = Field(
        LOCALIZER, description="Class of localizer of the forecast, likewise of `localizers`"
    )


class PlanRequest(_StartAndGoal):
    """A request for one route."""

    weight: float = Field(
        DEFAULT_WEIGHT,
        ge=0.0,
        le=1e6,
        description="Extra cost of a metre where the layer is 1, in metres",
    )


class ParetoRequest(_StartAndGoal):
    """A request for one route for each weight."""

    weights: Column = Field(
        [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0],
        min_length=2,
        description="Extra cost of a metre where the layer is 1, in metres",
    )


class KeptPlanRequest(PlanRequest):
    """A request for one route, or for one for each weight, that nobody waits for."""

    weights: Column | None = Field(
        None,
        min_length=2,
        description="One route for each of them, as `pareto`; null: one route at `weight`",
    )


class LossStretch(BaseModel):
    """A stretch of a route on which robots get lost."""

    probability: float = Field(description="Share of all robots that get lost there")
    start_m: float = Field(description="Metres along the route")
    end_m: float = Field(description="Metres along the route")
    x_m: float = Field(description="Where most get lost")
    y_m: float = Field(description="Where most get lost")
    kind: str = Field(description="Error that grows there: open floor, sliding, heading or drift")
    direction_rad: float = Field(description="Direction of the largest error, from 0 to pi")


class ForecastPoint(BaseModel):
    """Forecast up to a place of a route."""

    distance_m: float = Field(description="Metres along the route")
    x_m: float = Field(description="Place on the route")
    y_m: float = Field(description="Place on the route")
    theta_rad: float = Field(description="Heading there")
    lost: float = Field(description="Share of robots that have been lost by then; never falls")
    error_m: float = Field(description="Root mean square error of those that are not lost")
    heading_error_rad: float = Field(description="The same of the heading")


class LossReliability(BaseModel):
    """Lost robots on routes forecast alike, in buildings that the class was not fitted to."""

    forecast_low: float = Field(description="Smallest forecast of these routes")
    forecast_high: float = Field(description="Largest one")
    routes: int = Field(description="Number of these routes")
    lost: float = Field(description="Share of the robots that got lost on them")
    lost_low: float = Field(description="Lower end of its 95 % interval")
    lost_high: float = Field(description="Upper end")


class RouteForecast(BaseModel):
    """Forecast of the robots that get lost on a route, as of `ambinav forecast --json`."""

    lost_probability: float = Field(description="Probability that a robot gets lost on the route")
    lost_probability_reliability: LossReliability | None = Field(description="null: not measured")
    text: str = Field(description="The probability and its main cause in a sentence")
    localizer: str = Field(description="Class of localizer")
    odometry: str = Field(description="Name of the odometry")
    largest_error_m: float = Field(description="Largest `error_m` of the curve")
    causes: list[LossStretch] = Field(description="The worst first")
    curve: list[ForecastPoint] = Field(description="From start to goal")


class PlannedRoute(BaseModel):
    """A route and its figures."""

    route: list[tuple[float, float]] = Field(description="Waypoints, metres")
    theta: list[float] = Field(description="Heading at each waypoint, radians")
    length: float = Field(description="Metres")
    cost: float = Field(description="1 + weight * layer, integrated over the length, metres")
    exposure: float = Field(description="The layer integrated over the length, metres")
    weight: float
    layer: str
    planner: str
    seed: int | None
    zone_metres: dict[str, float] = Field(description="Metres travelled in each zone")
    unexplored_metres: float = Field(
        description="Metres travelled where the map is unexplored or outside of the building"
    )
    longest_bad: float = Field(description="Longest stretch in corridor or open zones, metres")
    turn: float = Field(description="Sum of all turns, radians")
    seconds: float = Field(description="Planning time")
    forecast: RouteForecast | None = Field(description="Robots that get lost; null: not known")
    forecast_reason: str | None = Field(description="Reason if there is no forecast, a sentence")


class PlanInfo(BaseModel):
    """A plan whose result is kept."""

    id: str
    map: str = Field(description="Id of the map")
    state: Literal["waiting", "done", "failed"]
    route: PlannedRoute | None = Field(description="The route, when the plan is done")
    front: list[PlannedRoute] | None = Field(
        description="The routes of a plan with `weights`, sorted by weight, when it is done"
    )
    detail: str | None = Field(description="Reason of the failure, in a sentence")


@router.post("/plan", summary="Plan a route", response_model=PlannedRoute, responses=_ANSWERS)
async def post_plan(request: Request, id: str, content: PlanRequest) -> Response:
    """Plan a route and forecast it in a process of its own, and wait for it.

    Closing the connection ends the planning at once.
    """
    return await _planned(request, id, content, content.weight, None)


@router.post(
    "/pareto",
    summary="Plan the Pareto front of length and exposure",
    response_model=list[PlannedRoute],
    responses=_ANSWERS,
)
async def post_pareto(request: Request, id: str, content: ParetoRequest) -> Response:
    """Plan one route for each weight; sorted by weight. Otherwise as `plan`."""
    return await _planned(request, id, content, DEFAULT_WEIGHT, tuple(content.weights))


@router.post(
    "/plans", summary="Start a plan", status_code=202, response_model=PlanInfo, responses=_ANSWERS
)
async def post_plans(request: Request, id: str, content: KeptPlanRequest) -> Response:
    """Start a plan whose result is kept; `GET /v1/plans/ID` has it when it is done.

    If the server was started with `--state`, the plan and its result survive a restart.
    """
    context = context_of(request)
    weights = None if content.weights is None else tuple(content.weights)
    served, task = await _task(request, id, content, content.weight, weights)
    most = context.limits.client_jobs
    job = await context.plan_jobs.begin(served, task, client_of(request.scope), most)
    return as_json(_info(job), 202, location=f"{context.prefix}/v1/plans/{job.id}")


@kept.get("/{id}", summary="A plan", response_model=PlanInfo, responses=answers(401, 404))
async def get_plan(request: Request, id: str) -> Response:
    """Return the state of a plan, and its route or front when it is done."""
    return as_json(_info(context_of(request).plan_jobs.get(id)))


@kept.delete(
    "/{id}",
    summary="Cancel a plan",
    status_code=204,
    response_class=Response,
    responses=answers(401, 404),
)
async def delete_plan(request: Request, id: str) -> Response:
    """Stop a plan if it still runs, and delete its result."""
    context_of(request).plan_jobs.cancel(id)
    return Response(status_code=204)


def _info(job: PlanJob) -> PlanInfo:
    is_front = isinstance(job.routes, list)
    return PlanInfo(
        id=job.id,
        map=job.map,
        state=job.state,
        route=None if is_front else job.routes,
        front=job.routes if is_front else None,
        detail=job.detail,
    )


async def _planned(
    request: Request,
    id: str,
    content: _StartAndGoal,
    weight: float,
    weights: tuple[float, ...] | None,
) -> Response:
    context = context_of(request)
    served, task = await _task(request, id, content, weight, weights)

    async def work() -> Any:
        path = await context.in_thread(context.file_of, served)
        return await context.plans.run(dataclasses.replace(task, map_file=str(path)))

    return as_json(await while_connected(request, work()))


async def _task(
    request: Request,
    id: str,
    content: _StartAndGoal,
    weight: float,
    weights: tuple[float, ...] | None,
) -> tuple[ServedMap, PlanTask]:
    """Check a request, and return its map and its task without the map's file.

    Raises:
        Problem: there is no such map, or a value cannot be used.
    """
    context = context_of(request)
    served = await context.map(request, id)
    if content.time_s > context.limits.plan_seconds:
        raise Problem(
            422,
            f"time_s is {content.time_s:g}; this server takes at most "
            f"{context.limits.plan_seconds:g} s.",
            field="time_s",
        )
    if weights is not None:
        if len(weights) > context.limits.weights:
            raise Problem(
                422,
                f"There are more than {context.limits.weights} weights; give fewer.",
                field="weights",
            )
        if not all(0.0 <= each <= 1e6 for each in weights):
            raise Problem(
                422, "A weight is out of range; give weights from 0 to 1e6.", field="weights"
            )
    for field, name, choices in (
        ("odometry", content.odometry, tuple(ODOMETRIES)),
        ("localizer", content.localizer, localizer_classes()),  # never a file
    ):
        if name not in choices:
            raise Problem(422, f"{field} is {name!r}; {nearest(name, choices)}.", field=field)

    return served, PlanTask(
        map_file="",
        map_name=served.name,
        layer=content.layer or served.amap.cost_layer,
        weight=weight,
        weights=weights,
        start=tuple(content.start),
        goal=tuple(content.goal),
        planner=content.planner,
        seconds=content.time_s,
        seed=content.seed,
        radius=content.radius,
        odometry=content.odometry,
        localizer=content.localizer,
    )
