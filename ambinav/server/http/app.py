"""The application: maps, costs, tiles, plans and audits over HTTP, and the page."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from fastapi import APIRouter, FastAPI, Request
from starlette.responses import Response

from ambinav.maps.address import Address
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server import problems
from ambinav.server.http import audits as auditing
from ambinav.server.http import docs, layers, openapi, poses, shapes
from ambinav.server.http import edits as editing
from ambinav.server.http import plans as planning
from ambinav.server.http import view as looking
from ambinav.server.http.context import Context, context_of
from ambinav.server.http.models import Health, as_json
from ambinav.server.http.poses import InvalidBodyError
from ambinav.server.jobs.scratch import remove_left
from ambinav.server.limits import Guard, Limits
from ambinav.server.page_files import mount_page
from ambinav.server.served import ServedMaps
from ambinav.server.tiles.pyramid_store import key_of
from ambinav.version import __version__

LOOPBACK: Final = ("127.0.0.1", "localhost", "::1")
"""Names of this machine to itself."""

_TEXT: Final = (
    "Perceptual ambiguity maps: where a building leaves a range scanner lost, what a metre costs "
    "there, and routes around it. Lengths are metres, angles radians, poses in the map's frame "
    "(x forward, y left, theta counter-clockwise). Non-finite numbers are null in JSON. Errors are "
    "problem details (RFC 9457)."
)

health = APIRouter(prefix="/v1", tags=["server"])


@health.get("/health", summary="Whether the server is up", response_model=Health)
async def get_health(request: Request) -> Response:
    """Answer as soon as the server runs; no token is needed."""
    count = len(context_of(request).maps)
    return as_json({"status": "ok", "version": __version__, "maps": count})


def create_app(
    maps: Iterable[str | Path | AmbiguityMap],
    *,
    token: str | None = None,
    hosts: tuple[str, ...] | None = None,
    limits: Limits | None = None,
) -> FastAPI:
    """Create the application.

    Args:
        maps: Stores to open, folders or URLs, or maps; those of no file are called by their
            environment.
        token: Token required of requests; None: no token is required.
        hosts: Names that the server is addressed by, such as `LOOPBACK`; None: any.
        limits: Limits of requests.

    Raises:
        InputError: a store cannot be opened.
    """
    served = ServedMaps()
    for entry in maps:
        if isinstance(entry, AmbiguityMap):
            served.add(entry, str(entry.dataset.attrs["environment"]))
        else:
            address = Address.of(entry)
            path = None if address.folder is None else address.folder.resolve()
            key = None if path is None else key_of(path)
            served.add(AmbiguityMap.open(entry), address.stem, path, key)
    limits = Limits() if limits is None else limits
    context = Context(served, limits)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        stop = threading.Event()

        def tend() -> None:
            remove_left()
            context.keep_pyramids(stop)

        async def look_ahead() -> None:
            """Prepare what the page requests first; errors are reported by the later request."""
            for amap in served:
                with contextlib.suppress(Exception):
                    await context.once(amap, "worst", looking.worst_places)

        keeping = asyncio.create_task(asyncio.to_thread(tend))
        ahead = asyncio.create_task(look_ahead())
        try:
            yield
        finally:
            stop.set()
            ahead.cancel()
            await keeping
            await context.close()

    app = FastAPI(
        title="ambinav",
        version=__version__,
        description=_TEXT,
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.state.context = context
    problems.install(app)
    openapi.install(app, with_token=token is not None)
    app.add_exception_handler(InvalidBodyError, _on_invalid_body)
    for router in (
        health,
        looking.router,
        poses.router,
        shapes.router,
        layers.router,
        planning.router,
        editing.router,
        auditing.router,
        docs.router,
    ):
        app.include_router(router)
    mount_page(app)
    app.add_middleware(Guard, limits=limits, token=token, hosts=hosts)
    return app


async def _on_invalid_body(request: Request, error: Exception) -> Response:
    assert isinstance(error, InvalidBodyError)
    return error.response
