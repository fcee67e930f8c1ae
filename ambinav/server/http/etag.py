"""Conditional requests: whether a client has the version of a resource already."""

from __future__ import annotations

from starlette.requests import Request


def is_known(request: Request, tag: str) -> bool:
    """Return whether `If-None-Match` names an entity tag (RFC 9110, 13.1.2: compared weakly)."""
    if_none_match = request.headers.get("if-none-match")
    if if_none_match is None:
        return False
    named = {part.removeprefix("W/") for part in _tags(if_none_match)}
    return "*" in named or tag.removeprefix("W/") in named


def matches(if_match: str, tag: str) -> bool:
    """Return whether an `If-Match` names an entity tag (RFC 9110, 13.1.1: compared strongly)."""
    named = _tags(if_match)
    return "*" in named or tag in named


def _tags(header: str) -> set[str]:
    return {part.strip() for part in header.split(",")}
