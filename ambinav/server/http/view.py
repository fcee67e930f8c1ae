"""Routes of maps: descriptions, and the values at one pose."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
from fastapi import APIRouter, Request
from starlette.responses import FileResponse, Response

from ambinav.maps.judged_floor import JUDGED, REASONS
from ambinav.maps.zones import MEANINGS, NOT_FREE, ZONES
from ambinav.sensing.sight import look
from ambinav.server.http.context import context_of
from ambinav.server.http.describe import map_detail, map_info
from ambinav.server.http.etag import is_known
from ambinav.server.http.models import MapDetail, MapList, Nearest, Place, PoseValues, Scan, as_json
from ambinav.server.http.poses import Theta, Weight, X, Y
from ambinav.server.problems import Problem, answers
from ambinav.server.served import DEFAULT_WEIGHT, ServedMap, digest_of_map, finite, zone_name
from ambinav.server.warming import free_pose
from ambinav.server.wire import OCTETS
from ambinav.studies.audit.ambiguous_regions import AmbiguousRegion, find_ambiguous_regions
from ambinav.studies.audit.cause import cause_of

router = APIRouter(prefix="/v1/maps", tags=["maps"])


@router.get("", summary="The maps", response_model=MapList, responses=answers(401))
async def get_maps(request: Request) -> Response:
    """Return all served maps with their layers."""
    context = context_of(request)
    infos = [await context.in_thread(map_info, served) for served in context.maps]
    return as_json(MapList(maps=infos))


@router.get("/{id}", summary="A map", response_model=MapDetail, responses=answers(401, 404))
async def get_map(request: Request, id: str) -> Response:
    """Return the parameters of a map, its zones and its figures; `ETag` is the map's digest."""
    context = context_of(request)
    served = await context.map(request, id)
    body, digest = await context.once(served, "detail", _detail)
    headers = {"etag": f'"{digest}"'}
    return Response(body, media_type="application/json", headers=headers)


def _detail(served: ServedMap) -> tuple[bytes, str]:
    return bytes(as_json(map_detail(served)).body), served.digest


@router.get(
    "/{id}/map.npz",
    summary="The map itself",
    response_class=Response,
    responses={
        **answers(401, 404, 412),
        200: {"description": "Arrays in the format of NumPy", "content": {OCTETS: {}}},
        304: {"description": "The map is the one of If-None-Match"},
    },
)
async def get_arrays(request: Request, id: str) -> Response:
    """Return all arrays of a map in one .npz file, as `ambinav.Client` fetches them.

    Each array is named as its layer; `.about` is JSON in bytes with dimensions and attributes.
    `ETag` is the map's digest.
    """
    context = context_of(request)
    served = await context.map(request, id)
    headers = {"etag": f'"{await context.in_thread(digest_of_map, served)}"'}
    if is_known(request, headers["etag"]):
        return Response(status_code=304, headers=headers)
    path = await context.in_thread(context.file_of, served)
    response = FileResponse(path, media_type=OCTETS, headers=headers)
    response.chunk_size = 1 << 20  # each is read by a thread
    return response


@router.get(
    "/{id}/values",
    summary="All values at a pose",
    response_model=PoseValues,
    responses=answers(401, 404, 422),
)
async def get_values(
    request: Request, id: str, x: X, y: Y, theta: Theta = None, weight: Weight = DEFAULT_WEIGHT
) -> Response:
    """Return every layer's value at a pose, its cost and its zone.

    Without theta, layers with headings tell their mean over headings, and those without a mean
    nothing. Where there is no value, `reason` says why.
    """
    context = context_of(request)
    return as_json(
        await context.in_thread(pose_values, await context.map(request, id), x, y, theta, weight)
    )


def pose_values(
    served: ServedMap, x: float, y: float, theta: float | None, weight: float = DEFAULT_WEIGHT
) -> PoseValues:
    """Return all values of a map at a pose, metres and radians."""
    amap = served.amap
    reason = None
    if not all(map(math.isfinite, (x, y, 0.0 if theta is None else theta))):
        reason = "outside"
    at = np.array([x]), np.array([y])
    code = int(served.why(*at)[0])
    near = served.around(x, y) if code != 1 and reason is None else None
    values: dict[str, float | None] = {}
    for layer in amap.layers:
        has_theta = "theta" in amap.dataset.variables[layer].dims
        is_read = near is not None and (
            not has_theta or theta is not None or f"{layer}_mean" in amap.dataset
        )
        values[layer] = finite(near.sample(layer, x, y, theta)) if is_read and near else None
    for layer in amap.layers:
        at_heading = values[layer]
        if layer.startswith("zone") and at_heading is not None and at_heading >= len(ZONES):
            values[layer] = None
    cost = math.inf if near is None else _cost(served, x, y, theta, weight)
    if reason is None and values["level"] is None:
        reason = served.reasons(*at, np.array([True]))[0]
    nearest = judged = None
    if near is not None:
        nearest = _nearest(served, x, y, theta)
        judged = _reason(served, nearest)
    counts = judged == REASONS[JUDGED]
    return PoseValues.model_validate(
        {
            "x": x,
            "y": y,
            "theta": theta,
            "values": values,
            "cost": finite(cost),
            "zone": zone_name(values["zone"]) if values["zone"] is not None and counts else None,
            "judged": judged,
            "nearest": nearest,
            "reason": reason,
        }
    )


def _reason(served: ServedMap, at: Nearest) -> str | None:
    """Return whether the floor of a cell counts, or why not; None where it is not free."""
    data = served.amap.dataset
    row, column = (
        int(np.searchsorted(data[axis].values, value)) for axis, value in (("y", at.y), ("x", at.x))
    )
    code = int(served.amap.judged.code[row, column])
    return None if code == NOT_FREE else REASONS[code]


def _cost(served: ServedMap, x: float, y: float, theta: float | None, weight: float) -> float:
    """Return the cost per metre at a pose; without a heading, of the layer's mean over headings."""
    layer = served.amap.cost_layer
    if theta is None and "theta" in served.amap.dataset[layer].dims:
        layer = f"{layer}_mean"
        if layer not in served.amap.dataset:
            return math.inf
    cost = served.service(layer, weight).cost(x, y, theta)
    assert isinstance(cost, float)
    return cost


def _nearest(served: ServedMap, x: float, y: float, theta: float | None) -> Nearest:
    data = served.amap.dataset
    heading = None
    if served.amap.has_theta and theta is not None:
        headings = data["theta"].values
        step = 2.0 * math.pi / headings.size
        heading = float(headings[round((theta - float(headings[0])) / step) % headings.size])
    return Nearest(
        x=float(data["x"].values[np.abs(data["x"].values - x).argmin()]),
        y=float(data["y"].values[np.abs(data["y"].values - y).argmin()]),
        theta=heading,
    )


@router.get(
    "/{id}/scan", summary="Expected scan", response_model=Scan, responses=answers(401, 404, 422)
)
async def get_scan(request: Request, id: str, x: X, y: Y, theta: Theta = None) -> Response:
    """Return the ends of the scanner's beams, without noise; beams without echo at full range.

    A pose outside of the free space has no scan: every list is empty.
    """
    context = context_of(request)
    return as_json(
        await context.in_thread(expected_scan, await context.map(request, id), x, y, theta)
    )


def expected_scan(served: ServedMap, x: float, y: float, theta: float | None) -> Scan:
    """Return the expected scan at a pose."""
    heading = 0.0 if theta is None else theta
    empty = Scan(x=[], y=[], hit=[], origin_x=[], origin_y=[], sentence="No robot can be there.")
    if not all(map(math.isfinite, (x, y, heading))) or served.why(np.array([x]), np.array([y]))[0]:
        return empty
    sight = look(served.amap.environment, served.scanner, x, y, heading)
    hit = np.isfinite(sight.distance)
    reach = np.where(hit, sight.distance, sight.max_range)
    ends = sight.origin + reach[:, None] * np.column_stack([np.cos(sight.axis), np.sin(sight.axis)])
    ends = np.where(hit[:, None], sight.hit, ends)
    return Scan(
        x=ends[:, 0].tolist(),
        y=ends[:, 1].tolist(),
        hit=hit.tolist(),
        origin_x=sight.origin[:, 0].tolist(),
        origin_y=sight.origin[:, 1].tolist(),
        sentence=sight.sentence,
    )


@router.get(
    "/{id}/worst", summary="Worst places", response_model=list[Place], responses=answers(401, 404)
)
async def get_worst(request: Request, id: str) -> Response:
    """Return the connected regions of the corridor and open zones, the worst first."""
    context = context_of(request)
    return as_json(await context.once(await context.map(request, id), "worst", worst_places))


def worst_places(served: ServedMap) -> list[Place]:
    """Return the worst regions of a map, at most `MOST_PLACES`."""
    return [_place(served, region) for region in find_ambiguous_regions(served.amap, MOST_PLACES)]


def first_values(served: ServedMap) -> None:
    """Compute the values and the scan of a place, whose code is compiled at the first time."""
    place = free_pose(served.amap)
    if place is not None:
        pose_values(served, *place, 0.0)
        with suppress(Problem):  # it does not contain its scanner
            expected_scan(served, *place, 0.0)


MOST_PLACES = 50
"""Most regions listed."""


def _cause(served: ServedMap, region: AmbiguousRegion) -> str:
    """Return the cause of a region, as the audit gives it; else the meaning of its zone."""
    try:
        scanner = served.scanner
    except Problem:  # it does not contain its scanner
        return f"{region.zone}: {MEANINGS[ZONES.index(region.zone)]}"
    sight = look(served.amap.environment, scanner, region.x, region.y, region.worst_heading or 0.0)
    return cause_of(sight, region.direction).sentence


def _place(served: ServedMap, region: AmbiguousRegion) -> Place:
    return Place(
        number=region.number,
        x=region.x,
        y=region.y,
        theta=region.worst_heading,
        zone=region.zone,
        level=region.level,
        area_m2=region.area,
        length=region.length,
        width=region.width,
        reason=_cause(served, region),
        weak_direction=region.direction,
        bounds=region.outline,
    )
