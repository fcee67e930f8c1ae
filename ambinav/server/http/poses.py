"""Routes of costs, levels and rewards: one pose, or many in JSON or binary."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, Final, TypeVar

import numpy as np
from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ValidationError
from starlette.responses import Response

from ambinav.geometry.motion.steering import Steering
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.server.http.context import Context, context_of
from ambinav.server.http.models import (
    CostPoses,
    Costs,
    Levels,
    Motion,
    OneCost,
    Poses,
    Rewards,
    Steps,
    as_json,
)
from ambinav.server.problems import Problem, answers, invalid
from ambinav.server.served import DEFAULT_WEIGHT, ServedMap
from ambinav.server.wire import OCTETS, POSE_COLUMNS, STEP_COLUMNS, packed, unpacked

Model = TypeVar("Model", bound=BaseModel)

router = APIRouter(prefix="/v1/maps/{id}", tags=["poses"])

INLINE: Final = 512
"""Rows of a batch that are worked out at once; more would hold up other requests."""

OF_BINARY: Final = ("columns", "layer", "weight", "steering", "turning_radius")
"""Parameters of the query that say of a binary body what one in JSON says itself."""

METRES: Final = 40.0
"""Metres of a step whose reward takes as long as one row of a batch."""

_BATCH = answers(400, 401, 404, 408, 413, 415, 422)


def _body_schema(model: type[Poses] | type[Steps], columns: tuple[str, ...]) -> dict[str, Any]:
    """Return the OpenAPI description of a JSON or binary body and of the binary answer."""
    return {
        "requestBody": {
            "required": True,
            "content": {
                "application/json": {"schema": model.model_json_schema()},
                OCTETS: {
                    "schema": {
                        "type": "string",
                        "format": "binary",
                        "description": "Columns of little-endian float64, one after the other; the "
                        f"query parameter `columns` names them, of {', '.join(columns)}.",
                    }
                },
            },
        }
    }


_BINARY_ANSWER: Final = {
    OCTETS: {
        "schema": {
            "type": "string",
            "format": "binary",
            "description": "Answer to a binary request: little-endian float64 with nan and inf.",
        }
    }
}
Columns = Annotated[
    str | None, Query(description="Columns of a binary body in order, separated by commas")
]
LayerName = Annotated[str | None, Query(description="Layer; none: the map's own choice")]
Weight = Annotated[
    float, Query(description="Extra cost of a metre where the layer is 1, in metres", ge=0.0)
]
X = Annotated[float, Query(description="Metres, map frame")]
Y = Annotated[float, Query(description="Metres, map frame")]
Theta = Annotated[
    float | None, Query(description="Radians; needed where the layer depends on the heading")
]


@router.get(
    "/cost", summary="Cost of a pose", response_model=OneCost, responses=answers(401, 404, 422)
)
async def get_cost(
    request: Request,
    id: str,
    x: X,
    y: Y,
    theta: Theta = None,
    layer: LayerName = None,
    weight: Weight = DEFAULT_WEIGHT,
) -> Response:
    """Return the cost per metre at a pose, at least 1; null with a reason where no robot can be."""
    context = context_of(request)
    served = await context.map(request, id)
    await _prepare(context, served, layer, weight)

    def work() -> Response:
        cost = served.service(layer, weight).cost(x, y, theta)
        if math.isfinite(cost):
            return as_json({"cost": cost, "reason": None})
        reason = served.reasons(np.array([x]), np.array([y]), np.array([True]))[0]
        return as_json({"cost": None, "reason": reason})

    return await _answer(context, 1, work)


@router.post(
    "/cost",
    summary="Costs of poses",
    response_model=Costs,
    responses={**_BATCH, 200: {"content": _BINARY_ANSWER}},
    openapi_extra=_body_schema(CostPoses, POSE_COLUMNS),
)
async def post_cost(
    request: Request,
    id: str,
    columns: Columns = None,
    layer: LayerName = None,
    weight: Weight = DEFAULT_WEIGHT,
) -> Response:
    """Return the cost per metre at each pose; query parameters are for the binary form.

    In JSON, null with a reason where no robot can be; in binary inf.
    """
    context = context_of(request)
    served = await context.map(request, id)
    table, content = await _read(request, CostPoses, columns, POSE_COLUMNS, 2)
    if content is not None:
        layer, weight = content.layer, content.weight
    x, y, theta = _poses(table, context)
    await _prepare(context, served, layer, weight)
    service = served.service(layer, weight)

    def work() -> Response:
        cost = np.asarray(service.cost(x, y, theta))
        if content is None:
            return _octets(cost)
        reasons = served.reasons(x, y, ~np.isfinite(cost))
        return as_json({"cost": cost.tolist(), "reason": reasons})

    return await _answer(context, len(x), work)


@router.post(
    "/level",
    summary="Values of a layer at poses",
    response_model=Levels,
    responses={**_BATCH, 200: {"content": _BINARY_ANSWER}},
    openapi_extra=_body_schema(Poses, POSE_COLUMNS),
)
async def post_level(
    request: Request, id: str, columns: Columns = None, layer: LayerName = None
) -> Response:
    """Return the value of a layer (default `level`) at each pose, in the layer's unit.

    In JSON, null with a reason where there is none; in binary nan.
    """
    context = context_of(request)
    served = await context.map(request, id)
    table, content = await _read(request, Poses, columns, POSE_COLUMNS, 2)
    if content is not None:
        layer = content.layer
    x, y, theta = _poses(table, context)

    def work() -> Response:
        values = np.asarray(served.amap.sample(layer or "level", x, y, theta), dtype=np.float64)
        if content is None:
            return _octets(values)
        return as_json(
            {"level": values.tolist(), "reason": served.reasons(x, y, ~np.isfinite(values))}
        )

    # The first access to a layer copies it.
    return await context.in_thread(work)


@router.post(
    "/reward",
    summary="Rewards of motions",
    response_model=Rewards,
    responses={**_BATCH, 200: {"content": _BINARY_ANSWER}},
    openapi_extra=_body_schema(Steps, STEP_COLUMNS),
)
async def post_reward(
    request: Request,
    id: str,
    columns: Columns = None,
    layer: LayerName = None,
    steering: Annotated[
        Motion, Query(description="Motion model of the robot; se2: straight")
    ] = "se2",
    turning_radius: Annotated[
        float, Query(description="Turning radius of a car, metres", ge=0.0)
    ] = 0.0,
) -> Response:
    """Return minus the layer integrated over the metres of each motion: at most 0.

    Walls are not looked at; where a pose is not possible the nearest one that is counts.
    """
    context = context_of(request)
    served = await context.map(request, id)
    table, content = await _read(request, Steps, columns, STEP_COLUMNS, 4)
    if content is not None:
        layer, steering, turning_radius = content.layer, content.steering, content.turning_radius
    moves = None if steering == "se2" else Steering(steering, turning_radius)
    ends = _same_length(table, context)
    metres = _metres(ends, moves, context.limits.metres)
    await _prepare(context, served, layer, DEFAULT_WEIGHT)
    service = served.service(layer)

    def work() -> Response:
        rewards = np.asarray(
            service.reward(
                ends["x0"], ends["y0"], ends["x1"], ends["y1"],
                ends.get("theta0"), ends.get("theta1"), moves,
            )
        )  # fmt: skip
        return _octets(rewards) if content is None else as_json({"reward": rewards.tolist()})

    return await _answer(context, max(len(ends["x0"]), math.ceil(metres / METRES)), work)


def _metres(ends: dict[str, Floats], moves: Steering | None, most: float) -> float:
    """Return an upper bound of the metres travelled; it bounds the time for their rewards.

    Raises:
        Problem: they are too many.
    """
    straight = np.hypot(ends["x1"] - ends["x0"], ends["y1"] - ends["y0"])
    # No curve is longer than the straight line, a circle at each end, and the path around them.
    circles = 0.0 if moves is None else (4.0 * math.pi + 4.0) * moves.radius
    metres = float(np.sum(straight[np.isfinite(straight)] + circles))
    if metres > most:
        raise Problem(413, f"The steps travel {metres:.3g} m; send at most {most:.3g} m at a time.")
    return metres


async def _prepare(context: Context, served: ServedMap, layer: str | None, weight: float) -> None:
    """Create the service of a layer and weight, in a thread if that takes long."""
    if not served.has_service(layer, weight):
        await context.in_thread(served.service, layer, weight)


async def _answer(context: Context, rows: int, work: Callable[[], Response]) -> Response:
    """Compute a short answer at once, a long one or one that may compile code in a thread."""
    at_once = rows <= INLINE and context.warming.seconds is not None
    return work() if at_once else await context.in_thread(work)


def _is_binary(request: Request) -> bool:
    """Return whether a body is in the binary form.

    Raises:
        Problem: it is neither in that form nor in JSON, or it is in JSON, which holds all that is
            asked, and the query asks for something too.
    """
    kind = request.headers.get("content-type", "application/json").partition(";")[0].strip().lower()
    if kind == OCTETS:
        return True
    if kind == "application/json":
        for name in OF_BINARY:
            if name in request.query_params:
                where = "leave it out" if name == "columns" else f"give {name!r} in the body"
                raise Problem(
                    422, f"{name} in the query is only for a binary body; {where}.", field=name
                )
        return False
    raise Problem(415, f"The Content-Type is {kind!r}; send application/json or {OCTETS}.")


class InvalidBodyError(Exception):
    """A body that pydantic refuses."""

    def __init__(self, error: ValidationError) -> None:
        super().__init__(str(error))
        self.response = invalid(error.errors(include_url=False))


async def _read(
    request: Request, model: type[Model], columns: str | None, names: tuple[str, ...], needed: int
) -> tuple[dict[str, Floats], Model | None]:
    """Read a body; return its columns, and what it is in JSON; None: it is binary.

    Args:
        request: The request.
        model: What it is in JSON.
        columns: Columns of a binary body; None: those that are needed.
        names: Columns that there are.
        needed: Number of leading columns that are required.
    """
    body = await request.body()
    if _is_binary(request):
        return unpacked(body, columns or ",".join(names[:needed]), names, needed), None
    try:
        content = model.model_validate_json(body)
    except ValidationError as error:
        raise InvalidBodyError(error) from None
    column_values = {name: getattr(content, name) for name in names}
    table = {
        name: np.asarray(column, dtype=np.float64)
        for name, column in column_values.items()
        if column is not None
    }
    return table, content


def _same_length(table: dict[str, Floats], context: Context) -> dict[str, Floats]:
    """Return the columns, checked to be of one length and not too long."""
    lengths = {name: len(column) for name, column in table.items()}
    rows = next(iter(lengths.values()))
    if set(lengths.values()) != {rows}:
        counts = ", ".join(f"{name} {count}" for name, count in lengths.items())
        raise InputError(f"the columns differ in length ({counts}); give as many values in each.")
    if rows > context.limits.batch:
        raise Problem(
            413, f"The batch has {rows} rows; send at most {context.limits.batch} at a time."
        )
    return table


def _poses(table: dict[str, Floats], context: Context) -> tuple[Floats, Floats, Floats | None]:
    table = _same_length(table, context)
    return table["x"], table["y"], table.get("theta")


def _octets(values: Floats | float) -> Response:
    return Response(packed([np.asarray(values)]), media_type=OCTETS)
