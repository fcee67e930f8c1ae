"""uvicorn with the limits that the service needs."""

from __future__ import annotations

import asyncio
import gc
import ipaddress
import math
import socket
import sys
from collections import Counter
from collections.abc import Sequence
from typing import Any, ClassVar, Final

import uvicorn
from fastapi import FastAPI
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from ambinav.server.http.context import Context
from ambinav.server.limits import Limits

Network = ipaddress.IPv4Network | ipaddress.IPv6Network

KEEP_ALIVE: Final = 75
"""Seconds for which a connection stays open when nothing is asked."""
GRACE: Final = 5
"""Seconds for which requests may go on when the server ends."""
SWITCH: Final = 5e-4
"""Seconds after which a thread that works lets the loop of events go on; Python's own is ten times
as long, and a request waits for it several times."""
_FULL: Final = (
    b"HTTP/1.1 503 Service Unavailable\r\nretry-after: 5\r\nconnection: close\r\n"
    b"content-length: 0\r\n\r\n"
)


class Protocol(HttpToolsProtocol):
    """uvicorn's protocol, with limits on connections, request heads and slow readers.

    `limited` makes one for a server.
    """

    limits: ClassVar[Limits]
    proxies: ClassVar[tuple[Network, ...]]
    open_by_peer: ClassVar[Counter[str]]

    _head: float = 0.0
    _peer: str | None = None
    _arriving: asyncio.TimerHandle | None = None
    _draining: asyncio.TimerHandle | None = None
    _cycles: tuple[RequestResponseCycle, ...] = ()

    @classmethod
    def limited(cls, limits: Limits, proxies: Sequence[str]) -> type[Protocol]:
        """Return a class whose connections are counted together.

        Args:
            limits: Limits of connections, of heads, and of the time for reading answers.
            proxies: Addresses or networks with any number of connections.
        """
        trusted = tuple(ipaddress.ip_network(proxy) for proxy in proxies)
        values = {"limits": limits, "proxies": trusted, "open_by_peer": Counter()}
        return type("LimitedProtocol", (cls,), values)

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept a connection, unless its client has too many."""
        super().connection_made(transport)
        peer = transport.get_extra_info("peername")
        if peer and not self._is_proxy(str(peer[0])):
            self._peer = str(peer[0])
            self.open_by_peer[self._peer] += 1
            if self.open_by_peer[self._peer] > self.limits.connections:
                transport.write(_FULL)
                transport.close()
                return
        self._expect_head()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget a connection."""
        self._stop_arriving()
        self._stop_draining()
        if self._peer is not None:
            self.open_by_peer[self._peer] -= 1
            if not self.open_by_peer[self._peer]:
                del self.open_by_peer[self._peer]
            self._peer = None
        # Of requests sent without waiting for answers uvicorn sees to the last one only.
        for cycle in self._cycles:
            cycle.disconnected = True
            cycle.message_event.set()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Receive data from a client."""
        self._head += len(data)
        if self._head >= 0 and self._arriving is None:  # of a later request on the connection
            self._expect_head()
        super().data_received(data)
        if self._head > self.limits.head and not self.transport.is_closing():
            self.send_400_response("The header of the request is too long.")

    def on_headers_complete(self) -> None:
        """Stop counting: the body has limits of its own."""
        self._head = -math.inf
        self._stop_arriving()
        super().on_headers_complete()
        unanswered = [cycle for cycle in self._cycles if not cycle.response_complete]
        self._cycles = (*unanswered, self.cycle)

    def on_message_complete(self) -> None:
        """Start counting again for the next request."""
        self._head = 0.0
        super().on_message_complete()

    def pause_writing(self) -> None:
        """Wait for a client that reads its answer slowly, but not for ever."""
        super().pause_writing()
        if self._draining is None:
            self._draining = self.loop.call_later(self.limits.write_seconds, self.transport.abort)

    def resume_writing(self) -> None:
        """Go on with an answer."""
        self._stop_draining()
        super().resume_writing()

    def _is_proxy(self, peer: str) -> bool:
        return any(ipaddress.ip_address(peer) in network for network in self.proxies)

    def _expect_head(self) -> None:
        self._arriving = self.loop.call_later(self.limits.head_seconds, self._give_up)

    def _stop_arriving(self) -> None:
        if self._arriving is not None:
            self._arriving.cancel()
            self._arriving = None

    def _stop_draining(self) -> None:
        if self._draining is not None:
            self._draining.cancel()
            self._draining = None

    def _give_up(self) -> None:
        self._arriving = None
        if not self.transport.is_closing():
            self.transport.close()


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
        proxies: Addresses or networks of proxies whose `X-Forwarded-For` and `-Proto` are used.
        options: Options of `uvicorn.Config`.
    """

    def __init__(self, app: FastAPI, *, proxies: Sequence[str] = (), **options: Any) -> None:
        context = app.state.context
        assert isinstance(context, Context)
        defaults: dict[str, Any] = {
            "access_log": False,
            "http": Protocol.limited(context.limits, proxies),
            "ws": "none",
            "log_level": "warning",
            "timeout_keep_alive": KEEP_ALIVE,
            "timeout_graceful_shutdown": GRACE,
            "proxy_headers": bool(proxies),
            "forwarded_allow_ips": list(proxies),
        }
        super().__init__(uvicorn.Config(app, **(defaults | options)))
        self._context = context

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Shut down; uvicorn waits for connections, so event streams are closed first."""
        self._context.end()
        await self._context.end_audits()
        await super().shutdown(sockets)
        if self.force_exit:  # by a second Ctrl-C: it waits for no request, but left this out
            await self.lifespan.shutdown()
