"""uvicorn with the limits that the service needs."""

from __future__ import annotations

import gc
import math
import socket
import sys
from typing import Any, Final

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from ambinav.server.http.context import Context

KEEP_ALIVE: Final = 75
"""Seconds for which a connection stays open when nothing is asked."""
GRACE: Final = 5
"""Seconds for which requests may go on when the server ends."""
SWITCH: Final = 5e-4
"""Seconds after which a thread that works lets the loop of events go on; Python's own is ten times
as long, and a request waits for it several times."""
MOST_HEAD: Final = 64 * 1024
"""Bytes of a request before its body, about: they are kept until all have come."""


class Protocol(HttpToolsProtocol):
    """uvicorn's protocol, with a limit on the size of request heads."""

    _head: float = 0.0

    def data_received(self, data: bytes) -> None:
        """Receive data from a client."""
        self._head += len(data)
        super().data_received(data)
        if self._head > MOST_HEAD and not self.transport.is_closing():
            self.send_400_response("The header of the request is too long.")

    def on_headers_complete(self) -> None:
        """Stop counting: the body has a limit of its own."""
        self._head = -math.inf
        super().on_headers_complete()

    def on_message_complete(self) -> None:
        """Start counting again for the next request."""
        self._head = 0.0
        super().on_message_complete()


def favour_requests() -> None:
    """Shorten the waiting time of short requests; call it when all maps are open."""
    sys.setswitchinterval(SWITCH)
    # A garbage collection of all loaded objects takes 0.1 s or more and blocks all answers.
    gc.collect()
    gc.freeze()


class Server(uvicorn.Server):
    """Server of an application; on exit it first ends audits and their event streams.

    Args:
        app: Application of `create_app`.
        options: Options of `uvicorn.Config`.
    """

    def __init__(self, app: FastAPI, **options: Any) -> None:
        defaults: dict[str, Any] = {
            "access_log": False,
            "http": Protocol,
            "ws": "none",
            "log_level": "warning",
            "timeout_keep_alive": KEEP_ALIVE,
            "timeout_graceful_shutdown": GRACE,
        }
        super().__init__(uvicorn.Config(app, **(defaults | options)))
        context = app.state.context
        assert isinstance(context, Context)
        self._context = context

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Shut down; uvicorn waits for connections, so event streams are closed first."""
        await self._context.end_audits()
        await super().shutdown(sockets)
        if self.force_exit:  # by a second Ctrl-C: it waits for no request, but left this out
            await self.lifespan.shutdown()
