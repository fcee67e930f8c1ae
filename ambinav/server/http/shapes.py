"""Routes of lines and areas: zones, walls, weak directions."""

from __future__ import annotations

import math
from functools import partial
from typing import Annotated, Any, Final

import numpy as np
from fastapi import APIRouter, Query, Request
from pydantic_core import to_json
from shapely.geometry import mapping
from starlette.responses import Response

from ambinav.export.raster import Raster
from ambinav.geometry.map_frame import MAP_FRAME
from ambinav.maps.zones import ZONES
from ambinav.plotting import style
from ambinav.server.http.context import Context, context_of
from ambinav.server.http.models import Glyph, as_json
from ambinav.server.problems import Problem, answers
from ambinav.server.served import ServedMap
from ambinav.server.tiles.pyramid import floor_values

router = APIRouter(prefix="/v1/maps/{id}", tags=["drawing"])

GEOJSON: Final = "application/geo+json"
MOST_CELLS: Final = 1_000_000
"""Cells of zones that are outlined; a larger map is outlined coarser."""
MOST_WALLS: Final = 200_000
"""Walls that are sent as lines; of more there are tiles."""
MOST_GLYPHS: Final = 5_000

GEOJSON_ANSWER: Final[dict[int | str, Any]] = {
    200: {"description": "A FeatureCollection (RFC 7946)", "content": {GEOJSON: {}}}
}


@router.get(
    "/zones.geojson",
    summary="Zones as polygons",
    response_class=Response,
    responses={**answers(401, 404), **GEOJSON_ANSWER},
)
async def get_zones(request: Request, id: str) -> Response:
    """Return one MultiPolygon for each zone, metres, in the map's frame.

    Maps of more than a million cells are outlined coarser. Of a map with headings the mean over
    them.
    """
    context = context_of(request)
    served = await context.map(request, id)
    body = await context.once(served, "zones", partial(_zones, context))
    return Response(body, media_type=GEOJSON)


def _zones(context: Context, served: ServedMap) -> bytes:
    amap = served.amap
    layer = "zone_mean" if "theta" in amap.dataset["zone"].dims else "zone"
    values = floor_values(amap, layer, None)
    halvings = 0
    while values.size >> (2 * halvings) > MOST_CELLS:
        halvings += 1
    if halvings:
        values = context.tiles(served).pyramids.get(layer).at(halvings, "mean")
    x0, _, _, y1 = amap.bounds
    side = amap.spacing * 2**halvings
    # Tiles begin at the largest y, and so do the cells of a coarser level.
    raster = Raster(x0, y1 - len(values) * side, side, values.shape)
    features = []
    for code, zone in enumerate(ZONES):
        area = raster.outline(values[::-1] == code)
        if not area.is_empty:
            properties = {
                "zone": zone,
                "area_m2": area.area,
                "colour": style.ZONE_COLOURS[code].lower(),
            }
            features.append(
                {"type": "Feature", "properties": properties, "geometry": mapping(area)}
            )
    return to_json({"type": "FeatureCollection", **MAP_FRAME, "features": features})


@router.get(
    "/walls.geojson",
    summary="Walls as lines",
    response_class=Response,
    responses={**answers(401, 404, 413), **GEOJSON_ANSWER},
)
async def get_walls(request: Request, id: str) -> Response:
    """Return MultiLineStrings of the walls, the frontiers, and the reflecting walls.

    A map of very many walls has tiles of them instead, in the layer `walls`.
    """
    context = context_of(request)
    body = await context.once(await context.map(request, id), "walls", _walls)
    return Response(body, media_type=GEOJSON)


def _walls(served: ServedMap) -> bytes:
    segments = served.amap.segments
    if len(segments.xy) > MOST_WALLS:
        raise Problem(
            413,
            f"The map has {len(segments.xy)} walls, too many to send as lines; request the tiles "
            "of the layer walls.",
        )
    features = []
    for kind, chosen in (
        ("wall", segments.walls),
        ("frontier", ~segments.walls),
        ("reflector", segments.reflectors),
    ):
        lines = segments.xy[chosen].reshape(-1, 2, 2).tolist()
        if lines:
            geometry = {"type": "MultiLineString", "coordinates": lines}
            features.append({"type": "Feature", "properties": {"kind": kind}, "geometry": geometry})
    return to_json({"type": "FeatureCollection", **MAP_FRAME, "features": features})


@router.get(
    "/direction",
    summary="Weak directions",
    response_model=list[Glyph],
    responses=answers(401, 404, 422),
)
async def get_direction(
    request: Request,
    id: str,
    bbox: Annotated[
        str | None, Query(description="x0,y0,x1,y1 in metres; none: the whole map")
    ] = None,
    max: Annotated[
        int, Query(description="Maximum number of directions", ge=1, le=MOST_GLYPHS)
    ] = 500,
) -> Response:
    """Return the directions of unobservable sliding at points of a square grid.

    Of a map with headings the mean over them. Where both radii are equal there is no direction to
    speak of, and nothing is sent.
    """
    context = context_of(request)
    served = await context.map(request, id)
    box = served.amap.bounds if bbox is None else _box(bbox)
    return as_json(await context.in_thread(_glyphs, served, box, max))


PRONOUNCED: Final = 0.15
"""Difference of the relative radii from which a direction is given."""


def _box(text: str) -> tuple[float, float, float, float]:
    try:
        x0, y0, x1, y1 = (float(part) for part in text.split(","))
    except ValueError:
        x0 = math.nan
    if not (math.isfinite(x0) and all(map(math.isfinite, (y0, x1, y1))) and x0 < x1 and y0 < y1):
        raise Problem(
            422, f"bbox is {text[:60]!r}; give x0,y0,x1,y1 in metres, x0 < x1, y0 < y1.",
            field="bbox",
        )  # fmt: skip
    return x0, y0, x1, y1


def _glyphs(
    served: ServedMap, box: tuple[float, float, float, float], most: int
) -> list[dict[str, Any]]:
    amap = served.amap
    xs, ys = amap.dataset["x"].values, amap.dataset["y"].values
    left, right = np.searchsorted(xs, (box[0], box[2]))
    low, high = np.searchsorted(ys, (box[1], box[3]))
    # A grid of about three times as many points: most lie in walls or have no direction.
    step = max(math.ceil(math.sqrt((right - left) * (high - low) / (3.0 * most))), 1)
    while True:
        rows, columns = (
            slice(int(first) + step // 2, int(last), step)
            for first, last in ((low, high), (left, right))
        )
        direction, major, minor = (
            amap.floor(name).values[rows, columns] for name in ("direction", "major", "minor")
        )
        clear = np.isfinite(direction) & (major - minor >= PRONOUNCED)
        clear &= amap.judged.counted[rows, columns]
        if clear.sum() <= most:
            break
        step += 1
    row, column = np.nonzero(clear)
    return [
        {"x": x, "y": y, "direction": d, "major": a, "minor": b}
        for x, y, d, a, b in zip(
            xs[columns][column].tolist(),
            ys[rows][row].tolist(),
            direction[clear].astype(float).tolist(),
            major[clear].astype(float).tolist(),
            minor[clear].astype(float).tolist(),
            strict=True,
        )
    ]
