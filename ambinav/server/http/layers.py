"""Routes of layers as pictures: scales and tiles."""

from __future__ import annotations

import zlib
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Path, Query, Request
from starlette.responses import Response

from ambinav.server.http.context import context_of
from ambinav.server.http.etag import is_known
from ambinav.server.http.models import LayerScale, LegendEntry, as_json
from ambinav.server.problems import answers
from ambinav.server.served import check_layer
from ambinav.server.tiles.pyramid import TILE, WALLS
from ambinav.server.tiles.render import legend

router = APIRouter(prefix="/v1/maps/{id}/layers/{layer}", tags=["drawing"])

_PNG: Final[dict[int | str, Any]] = {
    200: {"description": "256 x 256 pixels, with a palette", "content": {"image/png": {}}},
    304: {"description": "The tile is unchanged since the version in If-None-Match"},
}

LayerName = Annotated[str, Path(description="One of the map's layers, or `walls`")]


@router.get("", summary="Scale of a layer", response_model=LayerScale, responses=answers(401, 404))
async def get_layer(request: Request, id: str, layer: LayerName) -> Response:
    """Return the rendering of a layer: its least and largest value, its zooms and its colours."""
    context = context_of(request)
    served = await context.map(request, id)
    tiles = context.tiles(served)
    if layer != WALLS:
        check_layer(served.amap, layer)
    drawn = await context.in_thread(tiles.style, layer)
    units = "" if layer == WALLS else served.amap.dataset[layer].attrs.get("units", "")
    return as_json(
        LayerScale(
            name=layer,
            units=str(units),
            min=float(drawn.norm.vmin or 0.0),
            max=float(drawn.norm.vmax or 0.0),
            levels=tiles.pyramids.depth + 1,
            tile=TILE,
            legend=[LegendEntry.model_validate(entry) for entry in legend(drawn, layer)],
        )
    )


@router.get(
    "/tiles/{z}/{tx}/{ty}.png",
    summary="Tile of a layer",
    response_class=Response,
    responses={**answers(401, 404, 422), **_PNG},
)
async def get_tile(
    request: Request,
    id: str,
    layer: LayerName,
    z: Annotated[
        int, Path(description="Zoom: 0 shows the map in one tile, the largest one cell per pixel")
    ],
    tx: Annotated[int, Path(description="Column of the tile, from the map's smallest x")],
    ty: Annotated[int, Path(description="Row of the tile, from the map's largest y downwards")],
    stat: Annotated[
        Literal["mean", "worst"], Query(description="Statistic of the cells under a pixel")
    ] = "mean",
    theta: Annotated[
        float | None, Query(description="Heading, radians; none: the mean over headings")
    ] = None,
) -> Response:
    """Return a tile of 256 x 256 pixels, transparent without values; 304 if it is unchanged."""
    context = context_of(request)
    tiles = context.tiles(await context.map(request, id))
    name, heading = tiles.resolve(layer, theta)
    if tiles.is_ready(name, heading):
        png = tiles.png(name, heading, stat, z, tx, ty)
    else:
        png = await context.in_thread(tiles.png, name, heading, stat, z, tx, ty)
    # A server that is started again may have another map of this name: browsers ask.
    tag = f'"{zlib.crc32(png):x}-{len(png):x}"'
    headers = {"cache-control": "no-cache", "etag": tag}
    if is_known(request, tag):
        return Response(status_code=304, headers=headers)
    return Response(png, media_type="image/png", headers=headers)
