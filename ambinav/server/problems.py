"""Errors as problem details (RFC 9457): one form for all errors."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Mapping
from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, Field
from pydantic_core import to_json
from starlette.exceptions import HTTPException
from starlette.responses import Response

from ambinav.runtime.errors import InputError
from ambinav.runtime.files import disk_is_full

MEDIA_TYPE: Final = "application/problem+json"
OURS: Final = "This is the server's fault; its log says more. Please report it."
"""Message about a fault of the program."""
RETRY: Final = {"retry-after": "5"}
"""Headers of an answer that a later request may have better luck."""
MOST_DETAIL: Final = 1500
"""Bytes of a sentence in JSON: parts of requests are quoted in some."""
ENDING: Final = "The server is shutting down; repeat the request when it is back."
FULL: Final = "The disk of the server is full, so that nothing was kept; try again later."
UNKNOWN: Final = {
    404: "There is nothing at this address; /docs lists all addresses.",
    405: "This address does not accept that method; /docs lists those that it accepts.",
}
"""Messages where no route of the API matches."""

_log = logging.getLogger("ambinav.server")


def sentence_of(error: Exception, subject: str) -> str:
    """Log the error that ended something, and return what its client reads of it."""
    if disk_is_full(error):
        _log.error("%s: the disk is full", subject)
        return FULL
    _log.error("%s failed", subject, exc_info=error)
    return OURS


FIELDS: Final = frozenset(
    {"layer", "planner", "weight", "seconds", "iterations", "seed"} | {"start", "goal", "x", "y"}
)
"""Parameters that requests and functions of the core have in common, by the same names."""


class ProblemDetails(BaseModel):
    """A problem with a request, in the form of RFC 9457."""

    type: str = Field("about:blank", description="Kind of problem; about:blank: see the status")
    title: str = Field(description="Name of the status")
    status: int = Field(description="The HTTP status")
    detail: str = Field(description="The problem and its remedy, in a sentence")
    field: str | None = Field(None, description="The invalid parameter, if there is one")


class Problem(HTTPException):
    """A request that cannot be answered.

    Args:
        status: The HTTP status.
        detail: One sentence: what is wrong, and the remedy.
        field: The parameter at fault.
        headers: Further headers of the answer.
    """

    def __init__(
        self,
        status: int,
        detail: str,
        *,
        field: str | None = None,
        headers: Mapping[str, str] | None = None,
    ) -> None:
        super().__init__(status, detail, dict(headers) if headers else None)
        self.field = field


def too_many(client: str, most: int, noun: str) -> Problem:
    """Return the answer to a client that has its maximum number of requests or jobs."""
    return Problem(
        429, f"{client} has {most} {noun} here already; wait for one of them.", headers=RETRY
    )


SENTENCES: Final = {
    400: "The body does not match its Content-Type.",
    401: "The token is missing or wrong.",
    403: "The request comes from another site or names another host.",
    404: "There is no such map, layer or job.",
    408: "The body arrived too slowly.",
    409: "The state of the job does not allow this.",
    413: "The body or the batch is larger than the server accepts.",
    415: "The Content-Type is not supported.",
    422: "A parameter cannot be used; `detail` gives its name, the reason and the remedy.",
    412: "The map is not the one that If-Match names.",
    429: "The client has its maximum number of requests or jobs; try again later.",
    503: "The server is starting, or has its maximum number of running and waiting jobs; try again "
    "later.",
    507: "The disk of the server is full.",
    504: "The job took longer than the server allows.",
}
"""Meaning of each status."""


def answers(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI description of the problems that a route may answer with."""
    return {status: {"description": SENTENCES[status]} for status in statuses}


def problem_response(
    status: int, detail: str, field: str | None = None, headers: Mapping[str, str] | None = None
) -> Response:
    """Return the answer to a request that has a problem."""
    details = ProblemDetails(
        type="about:blank",
        title=HTTPStatus(status).phrase,
        status=status,
        detail=_shortened(detail, MOST_DETAIL),
        field=None if field is None else _shortened(field, MOST_DETAIL // 6),
    )
    body = to_json(details, exclude_none=True)
    return Response(body, status, dict(headers or {}), media_type=MEDIA_TYPE)


def _shortened(text: str, most: int) -> str:
    """Shorten a text whose JSON has more than `most` bytes."""
    # A character takes six bytes at most.
    return text if len(to_json(text)) <= most else f"{text[: most // 6]} ..."


def install(app: FastAPI) -> None:
    """Make an application answer every error with problem details."""

    async def on_http(request: Request, error: Exception) -> Response:
        assert isinstance(error, HTTPException)
        detail = error.detail if isinstance(error, Problem) else UNKNOWN.get(error.status_code)
        return problem_response(
            error.status_code,
            detail or str(error.detail),
            getattr(error, "field", None),
            error.headers,
        )

    async def on_input(request: Request, error: Exception) -> Response:
        return problem_response(422, str(error), named_field(str(error)))

    async def on_invalid(request: Request, error: Exception) -> Response:
        assert isinstance(error, RequestValidationError)
        return invalid(error.errors())

    async def on_fault(request: Request, error: Exception) -> Response:
        if sentence_of(error, f"{request.method} {request.url.path}") == FULL:
            return problem_response(507, FULL, headers=RETRY)
        return problem_response(500, OURS)

    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(InputError, on_input)
    app.add_exception_handler(RequestValidationError, on_invalid)
    for kind in (OSError, sqlite3.Error, Exception):  # of the first two the traceback is no news
        app.add_exception_handler(kind, on_fault)


def named_field(detail: str) -> str | None:
    """Return the parameter that a sentence of ours begins with: "weight is inf; give ..."."""
    name, separator, _ = detail.partition(" is ")
    return name if separator and name in FIELDS else None


def invalid(errors: Any) -> Response:
    """Return the answer to a request that pydantic refuses; only the first error is named."""
    first = errors[0]
    place = [str(part) for part in first["loc"] if part not in ("body", "query", "path", "header")]
    name = ".".join(place)
    if first["type"] in ("json_invalid", "value_error.jsondecode"):
        return problem_response(400, f"The body is not valid JSON ({first.get('msg', '')}).")
    message = str(first["msg"]).rstrip(".")
    return problem_response(422, f"{name or 'the body'}: {message}.", name or None)
