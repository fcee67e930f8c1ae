"""Routes of edits: obstacles added to a map, and downloads of the result."""

from __future__ import annotations

import time
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Query, Request
from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import to_json
from starlette.responses import Response

from ambinav.buildings.obstacle_file import (
    HIGHEST,
    THICKEST,
    THINNEST,
    DrawnObstacle,
    collection,
    obstacles_of,
)
from ambinav.buildings.plan_writer import plan_geojson
from ambinav.maps.zones import BAD, ZONES
from ambinav.server.http.context import Context, context_of
from ambinav.server.http.models import FIRST_ONLY, as_json
from ambinav.server.http.shapes import GEOJSON, GEOJSON_ANSWER
from ambinav.server.jobs.edit_sessions import EditedMap
from ambinav.server.jobs.plan_jobs import while_connected
from ambinav.server.limits import Limits
from ambinav.server.problems import Problem, answers
from ambinav.server.served import ServedMap

router = APIRouter(prefix="/v1/maps/{id}", tags=["editing"])

NAME: Final = "^[A-Za-z0-9_-]{1,64}$"
"""Pattern of names of sessions and editors."""
MOST_STEPS: Final = 2**53
"""Larger numbers are not exact in JSON."""


class _GeoJsonPart(BaseModel):
    """A part of GeoJSON; unknown members are ignored."""

    model_config = ConfigDict(strict=True, allow_inf_nan=False)


Position = Annotated[
    list[float], Field(min_length=2, max_length=3, description="x and y, metres"), FIRST_ONLY
]


class PointShape(_GeoJsonPart):
    """Position of a round obstacle."""

    type: Literal["Point"] = Field(description="GeoJSON type")
    coordinates: Position = Field(description="x and y of the centre, metres")


class LineShape(_GeoJsonPart):
    """Position of a straight obstacle."""

    type: Literal["LineString"] = Field(description="GeoJSON type")
    coordinates: Annotated[list[Position], Field(min_length=2), FIRST_ONLY] = Field(
        description="Vertices, metres"
    )


class ObstacleProperties(_GeoJsonPart):
    """Properties of an obstacle."""

    kind: Literal["post", "panel", "wall", "reflector"] = Field(
        description="A post is a Point; a panel or a wall is a LineString; a reflector is either"
    )
    radius: float | None = Field(
        None,
        ge=THINNEST,
        le=THICKEST,
        description="Radius of a Point, metres; required for a Point",
    )
    thickness: float | None = Field(
        None, ge=0.0, le=THICKEST, description="Thickness of a LineString, metres; null: 0"
    )
    bottom: float | None = Field(
        None,
        ge=0.0,
        le=HIGHEST,
        description="Height of the lower edge above the floor, metres, in space; null: 0",
    )
    top: float | None = Field(
        None,
        gt=0.0,
        le=HIGHEST,
        description="Height of the upper edge, metres, in space; null: that of the building",
    )


class ObstacleFeature(_GeoJsonPart):
    """An obstacle."""

    type: Literal["Feature"] = Field(description="GeoJSON type")
    properties: ObstacleProperties = Field(description="Kind and dimensions")
    geometry: Annotated[PointShape | LineShape, Field(discriminator="type")] = Field(
        description="Position"
    )


class ObstacleCollection(_GeoJsonPart):
    """Obstacles to add to a building, as GeoJSON; metres, in the map's frame."""

    type: Literal["FeatureCollection"] = Field(description="GeoJSON type")
    features: Annotated[list[ObstacleFeature], FIRST_ONLY] = Field(
        description="The obstacles; empty: returns the original map, as a step of the session or, "
        "without one, to prepare a process for edits"
    )


class ZoneChange(BaseModel):
    """Area of judged floor in a zone, before and after."""

    zone: str
    code: int = Field(description="Value in the layer `zone`")
    before_m2: float = Field(description="Area in the original map, square metres")
    after_m2: float = Field(description="Area in the edited map, square metres")


class Edited(BaseModel):
    """An edited map, which all other routes can serve."""

    id: str = Field(
        description="Id of the edited map in addresses; depends on the original and the obstacles"
    )
    map: str = Field(description="Id of the original map")
    obstacles: int = Field(description="Number of added obstacles")
    zones: list[ZoneChange]
    bad_before_m2: float = Field(description="Area of corridor and open zones, original map")
    bad_after_m2: float = Field(description="Area of corridor and open zones, edited map")
    step: int | None = Field(description="Its step of the session; null: it is none")
    seconds: float = Field(description="Computing time; almost 0 for a map that was still kept")


Session = Annotated[
    str | None,
    Query(description="Any name; only the latest edit of a session is computed", pattern=NAME),
]


@router.post(
    "/edits",
    summary="Edit a map",
    response_model=Edited,
    responses=answers(400, 401, 403, 404, 408, 409, 413, 422, 429, 503, 504),
)
async def post_edits(
    request: Request,
    id: str,
    content: ObstacleCollection,
    session: Session = None,
    draft: Annotated[
        bool, Query(description="True: no step of the session, as while something is dragged")
    ] = False,
    after: Annotated[
        int | None,
        Query(
            ge=0,
            le=MOST_STEPS,
            description="Step that the session was at when it was last seen; if somebody else has "
            "changed it since, the answer is 409",
        ),
    ] = None,
    editor: Annotated[
        str | None,
        Query(
            description="Any name of who edits: own steps are none of somebody else", pattern=NAME
        ),
    ] = None,
) -> Response:
    """Add obstacles to a map's building; another process computes the map around them.

    The original stays what it is. The edited map is served under an id of its own, and is
    computed again if it was forgotten meanwhile. It becomes a step of the session, which can be
    undone. Closing the connection, or another edit of the session, ends the work.
    """
    context = context_of(request)
    base = await context.map(request, id)
    if isinstance(base, EditedMap):
        raise Problem(
            422,
            f"{id!r} is edited itself; post all obstacles to the original, {base.base.name!r}.",
            field="id",
        )
    obstacles = _checked(content, base, context.limits)

    async def work() -> Edited:
        begun = time.monotonic()
        edited, step = await context.edits.find(
            base, obstacles, session, draft=draft, after=after, editor=editor
        )
        return await edited_answer(context, base, edited, step, time.monotonic() - begun)

    return as_json(await while_connected(request, work()))


def _checked(
    content: ObstacleCollection, base: ServedMap, limits: Limits
) -> tuple[DrawnObstacle, ...]:
    """Check and return the obstacles of a request.

    Raises:
        InputError: one of them is none.
        Problem: they are too many, or one lies outside of the map.
    """
    if len(content.features) > limits.obstacles:
        raise Problem(
            422,
            f"There are {len(content.features)} obstacles; this server takes {limits.obstacles}.",
            field="features",
        )
    obstacles = obstacles_of(content.model_dump(), "features")
    corners = sum(len(obstacle.points) for obstacle in obstacles)
    if corners > limits.corners:
        raise Problem(
            422,
            f"The obstacles have {corners} corners; this server takes {limits.corners}.",
            field="features",
        )
    (x0, y0, x1, y1), hair = base.amap.bounds, base.amap.spacing  # tags lie on the outer walls
    for number, obstacle in enumerate(obstacles, 1):
        for x, y in obstacle.points:
            if not (x0 - hair <= x <= x1 + hair and y0 - hair <= y <= y1 + hair):
                raise Problem(
                    422,
                    f"Obstacle {number} ({obstacle.kind}) is at ({x:g}, {y:g}), outside of the "
                    f"map, which goes from ({x0:g}, {y0:g}) to ({x1:g}, {y1:g}); move it inside.",
                    field="features",
                )
    return obstacles


async def edited_answer(
    context: Context, base: ServedMap, edited: ServedMap, step: int | None, seconds: float
) -> Edited:
    """Return the answer about an edited map."""
    before = await context.once(base, "areas", _areas)
    after = await context.once(edited, "areas", _areas)
    return Edited(
        id=edited.name,
        map=base.name,
        obstacles=len(edited.obstacles) if isinstance(edited, EditedMap) else 0,
        zones=[
            ZoneChange(zone=zone, code=code, before_m2=before[code], after_m2=after[code])
            for code, zone in enumerate(ZONES)
        ],
        bad_before_m2=sum(before[code] for code in BAD),
        bad_after_m2=sum(after[code] for code in BAD),
        step=step,
        seconds=seconds,
    )


def _areas(served: ServedMap) -> list[float]:
    """Return square metres of judged floor in each zone, as `describe.map_detail` has them."""
    counted = served.amap.judged.counted
    return [share.area for share in served.amap.zone_shares(mask=counted)]


@router.get(
    "/obstacles.geojson",
    summary="Obstacles of an edited map",
    response_class=Response,
    responses={**answers(401, 404), **GEOJSON_ANSWER},
)
async def get_obstacles(request: Request, id: str) -> Response:
    """Return the added obstacles as a file that `edits` accepts; empty for an original map."""
    served = await context_of(request).map(request, id)
    obstacles = served.obstacles if isinstance(served, EditedMap) else ()
    return Response(to_json(collection(obstacles)), media_type=GEOJSON)


@router.get(
    "/building.geojson",
    summary="The building",
    response_class=Response,
    responses={**answers(401, 404), **GEOJSON_ANSWER},
)
async def get_building(request: Request, id: str) -> Response:
    """Return the building as a drawn plan for `ambinav map`, with any added obstacles."""
    context = context_of(request)
    body = await context.once(await context.map(request, id), "building", _building)
    return Response(body, media_type=GEOJSON)


def _building(served: ServedMap) -> bytes:
    document: dict[str, Any] = plan_geojson(served.amap.environment)
    return to_json(document)
