"""The OpenAPI document of FastAPI, with problem details as the form of errors."""

from __future__ import annotations

from typing import Any, Final

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi

from ambinav.server.access import PROBES
from ambinav.server.problems import MEDIA_TYPE, SENTENCES, ProblemDetails

_PROBLEM: Final = {"$ref": "#/components/schemas/ProblemDetails"}
_THEIRS: Final = ("HTTPValidationError", "ValidationError")


def install(app: FastAPI, *, with_token: bool) -> None:
    """Replace the OpenAPI document of an application.

    Args:
        app: The application.
        with_token: Whether requests must bear a token.
    """

    def document() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = _document(app, with_token)
        return app.openapi_schema

    app.openapi = document  # type: ignore[method-assign]


def _document(app: FastAPI, with_token: bool) -> dict[str, Any]:
    spec = get_openapi(
        title=app.title, version=app.version, description=app.description, routes=app.routes
    )
    for methods in spec["paths"].values():
        for route in methods.values():
            for status, answer in route["responses"].items():
                if status[0] in "45":
                    answer["description"] = SENTENCES[int(status)]
                    answer["content"] = {MEDIA_TYPE: {"schema": _PROBLEM}}
    schemas = spec["components"]["schemas"]
    for name in _THEIRS:
        schemas.pop(name, None)
    if with_token:
        spec["components"]["securitySchemes"] = {"token": {"type": "http", "scheme": "bearer"}}
        spec["security"] = [{"token": []}]
        for path in PROBES:
            spec["paths"][path]["get"]["security"] = []
    schemas["ProblemDetails"] = ProblemDetails.model_json_schema()
    return spec
