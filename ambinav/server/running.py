"""uvicorn as the service needs it."""

from __future__ import annotations

import socket
from typing import Any, Final

import uvicorn
from fastapi import FastAPI

from ambinav.server.context import Context

KEEP_ALIVE: Final = 75
"""Seconds for which a connection stays open when nothing is asked."""
GRACE: Final = 5
"""Seconds for which requests may go on when the server ends."""


class Server(uvicorn.Server):
    """Serves an application until it is told to end; audits and who follows them end first.

    Args:
        app: Of `create_app`.
        options: Of `uvicorn.Config`.
    """

    def __init__(self, app: FastAPI, **options: Any) -> None:
        defaults: dict[str, Any] = {
            "access_log": False,
            "log_level": "warning",
            "timeout_keep_alive": KEEP_ALIVE,
            "timeout_graceful_shutdown": GRACE,
        }
        super().__init__(uvicorn.Config(app, **(defaults | options)))
        context = app.state.context
        assert isinstance(context, Context)
        self._context = context

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End: uvicorn waits for its connections, and a stream of events would stay open."""
        await self._context.end_audits()
        await super().shutdown(sockets)
