"""Refusal of query parameters that a route does not have: a misspelt one would be ignored."""

from __future__ import annotations

from fastapi import FastAPI, Request

from ambinav.server.problems import Problem


async def check_query(request: Request) -> None:
    """Check the names of a request's query parameters against those that its route documents.

    Raises:
        Problem: one of them is not known; the known ones are named.
    """
    if not request.query_params:
        return
    app: FastAPI = request.app
    operation = app.openapi()["paths"][request.scope["route"].path][request.method.lower()]
    names = [each["name"] for each in operation.get("parameters", ()) if each["in"] == "query"]
    for name in request.query_params:
        if name not in names:
            has = f"it has {', '.join(names)}" if names else "it has none; leave it out"
            raise Problem(
                422, f"This address has no query parameter {name[:100]!r}; {has}.", field=name
            )
