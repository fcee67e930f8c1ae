"""The page: its files, its module of colours, and its content policy."""

from __future__ import annotations

from typing import Final

from fastapi import FastAPI
from starlette.datastructures import MutableHeaders
from starlette.responses import Response
from starlette.routing import Match, Mount
from starlette.staticfiles import StaticFiles
from starlette.types import Message, Receive, Scope, Send

from ambinav.reports.page.single_file import FOLDER, GENERATED
from ambinav.reports.page.style import style_module

POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content policy of the page: its own files and the service's answers, nothing from elsewhere."""


HEADERS: Final = {
    "Content-Security-Policy": POLICY,
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    # Browsers revalidate files each time, since another version may be served.
    "Cache-Control": "no-cache",
}


class PageFiles(StaticFiles):
    """Static files with `HEADERS`."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request for a file."""

        async def guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                MutableHeaders(scope=message).update(HEADERS)
            await send(message)

        await super().__call__(scope, receive, guarded)


class PageMount(Mount):
    """Mount of the page at all addresses except those of the service.

    Addresses under `/v1/` are left to the routes, which answer with the methods they accept.
    """

    def matches(self, scope: Scope) -> tuple[Match, Scope]:
        """Return whether an address belongs to the page, and the scope for its handler."""
        if scope["path"].startswith("/v1/"):
            return Match.NONE, {}
        return super().matches(scope)


def mount_page(app: FastAPI) -> None:
    """Serve `/` and all files of the page."""
    module = style_module()

    async def style() -> Response:
        return Response(module, media_type="text/javascript", headers=HEADERS)

    app.add_api_route(f"/{GENERATED}", style, include_in_schema=False)
    app.router.routes.append(PageMount("/", PageFiles(directory=FOLDER, html=True), name="page"))
