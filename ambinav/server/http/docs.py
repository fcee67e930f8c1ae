"""The documentation of the routes as a page that loads no external resources."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Request
from starlette.responses import HTMLResponse, Response

from ambinav.reports.pages import fill

router = APIRouter()


@router.get("/docs", include_in_schema=False)
async def get_docs(request: Request) -> Response:
    """Return the routes, their parameters and answers, from the OpenAPI document."""
    return HTMLResponse(
        docs_page(request.app.openapi()),
        headers={"content-security-policy": "default-src 'none'; style-src 'unsafe-inline'"},
    )


def docs_page(document: dict[str, Any]) -> str:
    """Convert an OpenAPI document to a page."""
    routes = [
        {"path": path, "method": method.upper(), **operation}
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    return fill(
        "ambinav.server",
        "docs.html.j2",
        {"kind": _type_text},
        info=document["info"],
        routes=routes,
        models=document["components"]["schemas"],
    )


def _type_text(schema: dict[str, Any]) -> str:
    """Describe the values that a schema allows, in a few words."""
    if "$ref" in schema:
        return str(schema["$ref"].rpartition("/")[2])
    if "anyOf" in schema:
        return " or ".join(_type_text(option) for option in schema["anyOf"])
    if "enum" in schema:
        return " | ".join(map(str, schema["enum"]))
    if "const" in schema:
        return str(schema["const"])
    if schema.get("type") == "array":
        return f"[{_type_text(schema.get('items', {}))}, ...]"
    return str(
        schema.get("title", "value") if "properties" in schema else schema.get("type", "any")
    )
