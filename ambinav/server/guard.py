"""Middleware that checks access and limits requests and bodies."""

from __future__ import annotations

import asyncio
import re
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator, MutableMapping
from contextlib import contextmanager
from typing import Any, Final

from starlette.requests import ClientDisconnect

from ambinav.server.access import PROBES, Access
from ambinav.server.limits import Limits
from ambinav.server.problems import ENDING, Problem, problem_response, too_many
from ambinav.server.wire import OCTETS

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_JOBS: Final = re.compile(r"/v1/maps/[^/]+/(plan|pareto|edits|sessions/.*)$")


def client_of(scope: Scope) -> str:
    """Return the address of a request's client; of a trusted proxy's request, its client's."""
    client = scope.get("client")
    return str(client[0]) if client else "?"


class Guard:
    """Middleware that checks access and limits the size, duration and number of requests.

    Args:
        app: The guarded application.
        limits: Limits of requests.
        access: Names of the server and rights of its users.
    """

    def __init__(self, app: App, limits: Limits, access: Access) -> None:
        self._app = app
        self._limits = limits
        self._access = access
        self._requests: Counter[str] = Counter()
        self._jobs: Counter[str] = Counter()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward a request, or answer it with a problem."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        headers, prefix = dict(scope["headers"]), self._access.prefix
        if prefix and scope["path"] == prefix:
            answer = problem_response(308, "The page is here.", headers={"location": f"{prefix}/"})
            await answer(scope, receive, send)
            return
        if prefix and scope["path"].startswith(f"{prefix}/"):  # of a proxy that leaves it
            scope["path"] = scope["path"].removeprefix(prefix)
        refusal = self._access.refusal(scope["method"], scope["path"], headers)
        if refusal is not None:
            await problem_response(refusal.status, refusal.detail, headers=refusal.headers)(
                scope, receive, send
            )
            return
        if b"content-length" in headers or b"transfer-encoding" in headers:
            most = self._largest_body(headers.get(b"content-type", b""))
            receive = _limit_body(receive, most, self._limits.body_seconds)
            length = headers.get(b"content-length", b"0")
            if length.isdigit() and int(length) > most:
                response = problem_response(413, too_large(most), headers={"connection": "close"})
                await response(scope, receive, send)
                return
        original_scope = scope
        if scope["method"] == "HEAD":
            scope = {**scope, "method": "GET"}  # uvicorn sends no body of its answer
        begun = False

        async def noted(message: Message) -> None:
            nonlocal begun
            begun = True
            await send(message)

        try:
            with self._counted(original_scope):
                await self._app(scope, receive, noted)
        except ClientDisconnect:
            return  # within its body
        except Problem as problem:  # of the quotas: no route has seen the request
            await problem_response(problem.status_code, problem.detail, headers=problem.headers)(
                scope, receive, send
            )
        except asyncio.CancelledError:
            # By uvicorn, of requests that outlast its end: the connection is closed, and a
            # traceback of each would say nothing more.
            if not begun:
                await problem_response(503, ENDING)(scope, receive, send)
        finally:
            original_scope["route"] = scope.get("route")

    @contextmanager
    def _counted(self, scope: Scope) -> Iterator[None]:
        """Count a request as long as it is answered.

        Raises:
            Problem: its client has too many already.
        """
        if scope["path"] in PROBES:
            yield
            return
        client, limits = client_of(scope), self._limits
        is_job = scope["method"] == "POST" and _JOBS.match(scope["path"]) is not None
        kinds = [(self._requests, limits.client_requests, "requests")]
        if is_job:
            kinds.append((self._jobs, limits.client_jobs, "jobs"))
        for counter, most, noun in kinds:
            if counter[client] >= most:
                raise too_many(client, most, noun)
        for counter, _, _ in kinds:
            counter[client] += 1
        try:
            yield
        finally:
            for counter, _, _ in kinds:
                counter[client] -= 1
                if not counter[client]:
                    del counter[client]

    def _largest_body(self, kind: bytes) -> int:
        """Return the largest body size for a Content-Type, bytes."""
        kind = kind.lower()
        if kind.startswith(b"multipart/"):
            return self._limits.upload
        is_binary = kind.partition(b";")[0].strip() == OCTETS.encode()
        return self._limits.body if is_binary else min(self._limits.body, self._limits.json)


def too_large(most: int) -> str:
    """Return the message about a body that is too large."""
    return (
        f"The body is larger than {most} bytes; send less at a time, or poses in the binary form, "
        f"{OCTETS}."
    )


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
