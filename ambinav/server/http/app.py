"""The application: maps, costs, tiles, plans and audits over HTTP, and the page."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator, Iterable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Final

from fastapi import Depends, FastAPI, Request
from starlette.responses import Response

from ambinav.maps.address import Address
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.server import problems
from ambinav.server.access import Access
from ambinav.server.guard import Guard
from ambinav.server.http import (
    audits,
    docs,
    edits,
    layers,
    openapi,
    plans,
    poses,
    probes,
    sessions,
    shapes,
    view,
)  # fmt: skip
from ambinav.server.http.context import Context
from ambinav.server.http.known_query import check_query
from ambinav.server.http.poses import InvalidBodyError
from ambinav.server.jobs.scratch import remove_left
from ambinav.server.jobs.state import State
from ambinav.server.limits import Limits
from ambinav.server.observer import Observer
from ambinav.server.page_files import mount_page
from ambinav.server.served import ServedMaps
from ambinav.server.tiles.pyramid_store import key_of
from ambinav.server.warming import Step
from ambinav.version import __version__

_TEXT: Final = (
    "Perceptual ambiguity maps: where a building leaves a range scanner lost, what a metre costs "
    "there, and routes around it. Lengths are metres, angles radians, poses in the map's frame "
    "(x forward, y left, theta counter-clockwise). Non-finite numbers are null in JSON. Errors are "
    "problem details (RFC 9457)."
)


def create_app(
    maps: Iterable[str | Path | AmbiguityMap],
    *,
    access: Access | None = None,
    limits: Limits | None = None,
    state: Path | None = None,
    processes: bool = False,
) -> FastAPI:
    """Create the application.

    Args:
        maps: Stores to open, folders or URLs, or maps; those of no file are called by their
            environment.
        access: Names of the server and rights of its users; None: this machine's, without a token.
        limits: Limits of requests.
        state: Folder in which edits and jobs are kept for the next start; None: they are not.
        processes: Whether the processes for plans and edits start before the first request.

    Raises:
        InputError: a store cannot be opened, or the folder of the state cannot be used.
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
    access = Access() if access is None else access
    context = Context(served, limits, State(state), access.prefix)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        stop = threading.Event()

        def tend() -> None:
            remove_left()
            context.keep_pyramids(stop)

        await context.resume()
        keeping = asyncio.create_task(asyncio.to_thread(tend))
        # The document that queries are checked against.
        first: list[Step] = [partial(context.in_thread, app.openapi)]
        first += [partial(context.once, amap, "worst", view.worst_places) for amap in served]
        first += [partial(context.in_thread, view.first_values, amap) for amap in served]
        ahead = asyncio.create_task(context.prepare(first, processes=processes))
        try:
            yield
        finally:
            stop.set()
            ahead.cancel()
            await asyncio.gather(ahead, return_exceptions=True)
            await keeping
            await context.close()
            if state is not None:
                context.state.close()

    app = FastAPI(
        title="ambinav",
        version=__version__,
        description=_TEXT,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # they would lead past a proxy's prefix
        lifespan=lifespan,
    )
    app.state.context = context
    problems.install(app)
    openapi.install(app, with_token=not access.is_open)
    app.add_exception_handler(InvalidBodyError, _on_invalid_body)
    app.include_router(probes.router)  # whoever watches may add to the address
    for router in (
        view.router,
        poses.router,
        shapes.router,
        layers.router,
        plans.router,
        plans.kept,
        edits.router,
        sessions.router,
        audits.router,
    ):
        app.include_router(router, dependencies=[Depends(check_query)])
    app.include_router(docs.router)
    mount_page(app)
    app.add_middleware(Guard, limits=limits, access=access)
    app.add_middleware(Observer, metrics=context.metrics)  # around the guard: refusals count too
    return app


async def _on_invalid_body(request: Request, error: Exception) -> Response:
    assert isinstance(error, InvalidBodyError)
    return error.response
