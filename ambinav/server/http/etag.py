"""Conditional requests: whether a client has the version of a resource already."""

from __future__ import annotations

from starlette.requests import Request


def is_known(request: Request, tag: str) -> bool:
    """Return whether `If-None-Match` names an entity tag (RFC 9110, 13.1.2: compared weakly)."""
    given = request.headers.get("if-none-match")
    if given is None:
        return False
    named = {part.strip().removeprefix("W/") for part in given.split(",")}
    return "*" in named or tag.removeprefix("W/") in named
