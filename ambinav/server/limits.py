"""Limits of requests: sizes, times and counts, and the middleware that enforces them."""

from __future__ import annotations

import asyncio
import hmac
import os
from collections.abc import Awaitable, Callable, MutableMapping
from dataclasses import dataclass, field
from typing import Any, Final
from urllib.parse import urlsplit

from starlette.requests import ClientDisconnect

from ambinav.server.problems import ENDING, Problem, problem_response
from ambinav.server.wire import OCTETS

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

OPEN_PATHS: Final = ("/v1/health", "/openapi.json", "/docs")
"""Paths that reveal nothing about a map: they need no token."""


@dataclass(frozen=True)
class Limits:
    """Limits of one request and of all jobs together.

    Attributes:
        body: Bytes of a body.
        json: Bytes of a body in JSON, or of no known type: reading it holds up all other requests.
        upload: Bytes of a body of uploaded files.
        body_seconds: Time for a body to arrive.
        batch: Poses or steps of a batch.
        metres: Travelled by the steps of a batch, about.
        plan_seconds: Longest planning time of a request.
        job_seconds: Time after which a plan is stopped.
        audit_seconds: Time after which an audit is stopped.
        plans: Plans that run at the same time.
        audits: Audits that run at the same time.
        waiting: Jobs of a kind that may wait for their turn.
        kept_audits: Finished audits whose map and report are kept; the oldest go first.
        audit_cells: Cells of an uploaded map's ambiguity map, over all headings.
        audit_beams: Beams of the scanner of an audit.
        weights: Weights of a Pareto front.
        edits: Edits that are worked out at the same time.
        edit_seconds: Time after which an edit is stopped.
        obstacles: Obstacles of an edit.
        corners: Corners of all obstacles of an edit together.
        kept_edits: Edited maps that are kept; of whoever has the most, the oldest go first.
        edit_bytes: Approximate bytes of the layers of all edited maps; the last map always stays.
    """

    body: int = 32 * 2**20
    json: int = 4 * 2**20
    upload: int = 64 * 2**20
    body_seconds: float = 30.0
    batch: int = 1_000_000
    metres: float = 5e7
    plan_seconds: float = 30.0
    job_seconds: float = 120.0
    audit_seconds: float = 900.0
    plans: int = field(default_factory=lambda: max((os.cpu_count() or 2) // 2, 1))
    audits: int = 1
    waiting: int = 8
    kept_audits: int = 8
    audit_cells: int = 4_000_000
    audit_beams: int = 20_000
    weights: int = 25
    edits: int = 1
    edit_seconds: float = 120.0
    obstacles: int = 100
    corners: int = 1000
    kept_edits: int = 8
    edit_bytes: int = 2**30


class Guard:
    """Middleware that checks token and origin and limits the size and duration of bodies.

    Args:
        app: The guarded application.
        limits: See there.
        token: Token required of requests; None: no token is required.
        hosts: Names that the server is addressed by; None: any. Where it listens to this machine
            alone, another name means that a page of another site was made to resolve to it.
    """

    def __init__(
        self, app: App, limits: Limits, token: str | None, hosts: tuple[str, ...] | None
    ) -> None:
        self._app = app
        self._limits = limits
        self._token = None if token is None else f"Bearer {token}".encode()
        self._hosts = hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, or answer it with a problem."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers = dict(scope["headers"])
        problem = self._refusal(scope, headers)
        if problem is not None:
            status, detail, more = problem
            await problem_response(status, detail, headers=more)(scope, receive, send)
            return
        if b"content-length" in headers or b"transfer-encoding" in headers:
            most = self._largest_body(headers.get(b"content-type", b""))
            receive = _limit_body(receive, most, self._limits.body_seconds)
            length = headers.get(b"content-length", b"0")
            if length.isdigit() and int(length) > most:
                response = problem_response(413, too_large(most), headers={"connection": "close"})
                await response(scope, receive, send)
                return
        if scope["method"] == "HEAD":
            scope = {**scope, "method": "GET"}  # uvicorn sends no body of its answer
        begun = False

        async def noted(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            await self._app(scope, receive, noted)
        except ClientDisconnect:
            return  # within its body
        except asyncio.CancelledError:
            # By uvicorn, of requests that outlast its end: the connection is closed, and a
            # traceback of each would say nothing more.
            if not begun:
                await problem_response(503, ENDING)(scope, receive, send)

    def _largest_body(self, kind: bytes) -> int:
        """Return the largest body size for a Content-Type, bytes."""
        kind = kind.lower()
        if kind.startswith(b"multipart/"):
            return self._limits.upload
        is_binary = kind.partition(b";")[0].strip() == OCTETS.encode()
        return self._limits.body if is_binary else min(self._limits.body, self._limits.json)

    def _refusal(
        self, scope: Scope, headers: dict[bytes, bytes]
    ) -> tuple[int, str, dict[str, str]] | None:
        """Return the reason to refuse a request before it is read; None if it may pass."""
        host = headers.get(b"host", b"").decode("latin-1")
        if self._hosts is not None and _name_of(host) not in self._hosts:
            return 403, f"This server is not called {host!r}; use {self._hosts[0]}.", {}
        origin = headers.get(b"origin")
        if origin is not None:
            try:
                site = urlsplit(origin.decode("latin-1")).netloc
            except ValueError:
                site = ""
            if site != host:
                return 403, "Requests from pages of other sites are refused.", {}
        path = scope["path"]
        if self._token is None or path in OPEN_PATHS or not path.startswith("/v1"):
            return None
        if hmac.compare_digest(headers.get(b"authorization", b""), self._token):
            return None
        return (
            401,
            "The token is missing or wrong; send the header `Authorization: Bearer TOKEN`.",
            {"www-authenticate": "Bearer"},
        )


def too_large(most: int) -> str:
    """Return the message about a body that is too large."""
    return (
        f"The body is larger than {most} bytes; send less at a time, or poses in the binary form, "
        f"{OCTETS}."
    )


def _name_of(host: str) -> str:
    """Return a Host header without its port."""
    try:
        return (urlsplit(f"//{host}").hostname or "").lower()
    except ValueError:
        return ""


def _limit_body(receive: Receive, most: int, seconds: float) -> Receive:
    """Limit the size and duration of a request body."""
    loop = asyncio.get_running_loop()
    end = loop.time() + seconds
    count, done = 0, False

    async def limited() -> Message:
        nonlocal count, done
        if done:
            return await receive()
        try:
            async with asyncio.timeout_at(end):
                message = await receive()
        except TimeoutError:
            done = True
            raise Problem(
                408,
                f"The body did not arrive within {seconds:g} s; send less at a time.",
                headers={"connection": "close"},
            ) from None
        count += len(message.get("body", b""))
        done = message["type"] != "http.request" or not message.get("more_body", False)
        if count > most:
            done = True
            raise Problem(413, too_large(most), headers={"connection": "close"})
        return message

    return limited
