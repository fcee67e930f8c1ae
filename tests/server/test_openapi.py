"""The OpenAPI document: complete, true to the answers, and no request breaks the server."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

import ambinav as an
from ambinav.server.access import PROBES
from tests.server.live import Live

METHODS = {"get", "post", "delete"}
PLAIN = {
    *("area_m2", "attrs", "bounds", "code", "colour", "cost", "environment", "judged_area_m2"),
    *("figures", "free_area_m2", "id", "label", "layer", "layers", "legend", "level", "map"),
    *(
        "maps",
        "meaning",
        "name",
        "nearest",
        "planner",
        "scanner",
        "seed",
        "state",
        "status",
        "text",
        "theta",
    ),
    *("units", "value", "values", "version", "weight", "width", "x", "y", "zone", "zones"),
}
"""Fields whose name says it all."""


@pytest.fixture(scope="module")
def document(live: Live) -> dict[str, Any]:
    found: dict[str, Any] = live.get("/openapi.json")
    return found


def test_every_route_is_documented(document: dict[str, Any]) -> None:
    count = 0
    for path, methods in document["paths"].items():
        assert set(methods) <= METHODS
        for method, route in methods.items():
            count += 1
            assert route["summary"] and route["description"], (path, method)
            assert "HTTPValidationError" not in str(route), (path, method)
            for status, answer in route["responses"].items():
                if status[0] in "45":
                    assert list(answer["content"]) == ["application/problem+json"], (path, status)
            for parameter in route.get("parameters", ()):
                if parameter["name"] not in ("id",):
                    assert parameter.get("description"), (path, parameter["name"])
            if path not in PROBES:
                assert "401" in route["responses"], path
    assert count > 15


def test_every_field_has_a_meaning_or_says_it_itself(document: dict[str, Any]) -> None:
    for name, model in document["components"]["schemas"].items():
        for field, schema in model.get("properties", {}).items():
            assert schema.get("description") or field in PLAIN, (name, field)


def test_the_page_of_the_documentation_names_every_route(
    live: Live, document: dict[str, Any]
) -> None:
    page = live.http.get("/docs").text
    for path in document["paths"]:
        assert path in page
    assert "http://" not in page and "https://" not in page


@pytest.mark.slow
def test_no_request_breaks_the_server(serve: Any, corridor: an.AmbiguityMap) -> None:
    """benchmarks/fuzz_server.py asks more: 100 000 requests."""
    pytest.importorskip("schemathesis")
    from fuzz_server import LIMITS, fuzz

    live: Live = serve([corridor], limits=LIMITS)
    counts = Counter[int]()
    fuzz(live.url, cases=80, seed=1, counts=counts)
    assert sum(counts.values()) >= 50
    assert all(status < 500 or status == 503 for status in counts)
