"""Routes for whoever watches the server: liveness, start-up, readiness and metrics."""

from __future__ import annotations

from fastapi import APIRouter, Request
from starlette.responses import Response

from ambinav.server.http.context import context_of
from ambinav.server.http.models import Health, Readiness, as_json
from ambinav.server.problems import ENDING, Problem, answers
from ambinav.version import __version__

router = APIRouter(prefix="/v1", tags=["server"])


@router.get("/health", summary="Whether the server is up", response_model=Health)
async def get_health(request: Request) -> Response:
    """Answer as soon as the server runs; no token is needed, as for the next two."""
    count = len(context_of(request).maps)
    return as_json({"status": "ok", "version": __version__, "maps": count})


@router.get(
    "/startup",
    summary="Whether the server has started",
    response_model=Readiness,
    responses=answers(503),
)
async def get_startup(request: Request) -> Response:
    """Answer when all code is compiled and all processes run; 503 until then."""
    warming = context_of(request).warming
    if warming.seconds is None:
        raise Problem(503, warming.sentence, headers={"retry-after": "1"})
    return as_json(Readiness(status="ready", seconds=warming.seconds))


@router.get(
    "/ready",
    summary="Whether the server is ready",
    response_model=Readiness,
    responses=answers(503),
)
async def get_ready(request: Request) -> Response:
    """Answer as `startup`, and with 503 again when the server ends."""
    if context_of(request).is_ending:
        raise Problem(503, ENDING, headers={"retry-after": "5"})
    return await get_startup(request)


@router.get(
    "/metrics",
    summary="Metrics",
    response_class=Response,
    responses={
        **answers(401),
        200: {"description": "Prometheus' text form", "content": {"text/plain": {}}},
    },
)
async def get_metrics(request: Request) -> Response:
    """Return counts and durations of requests, and the state of the jobs."""
    return Response(
        context_of(request).metrics.text(), media_type="text/plain; version=0.0.4; charset=utf-8"
    )
