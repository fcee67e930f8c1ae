"""Fuzz the service's OpenAPI document with schemathesis, and require no status 500.

    python benchmarks/fuzz_server.py --cases 100000 --out benchmarks/results/fuzz-server.md

Requests follow the document's schemas or break them on purpose; most of them name a map and a
layer that there are, in rounds by turns a map of a plan and one of a building in space. Every
answer must have a status, a type and a body that the document knows. Plans and audits are asked
for too, under limits that end them soon.
"""

from __future__ import annotations

import argparse
import time
from collections import Counter
from typing import Any

import httpx
import schemathesis
import shapely
from harness import arguments, report, table
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as seeded
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

import ambinav as an
from ambinav.server.limits import Limits

LIMITS = Limits(plan_seconds=0.05, job_seconds=5.0, audit_cells=50, audits=1, waiting=1, batch=1000)
"""Under which jobs end soon."""
SLOW = {"/plan": 0.03, "/pareto": 0.03, "/edits": 0.1, "/audits": 0.05, "/map.npz": 0.1}
"""Shares of an even number of cases that go to paths whose answers take long."""
KNOWN = {"layer": "level"}
"""Parameters of paths that there are, besides the map."""
KNOWN_SHARE = 0.8
"""Share of requests with these parameters; the others use random ones."""
ROUND = 8000
"""Cases of a round; each has a seed of its own, and goes through all routes."""
CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
]


def fuzz(url: str, cases: int, seed: int, counts: Counter[int]) -> None:
    """Send about half as many requests, shared by all routes; some have few distinct ones.

    Args:
        url: Address of the server.
        cases: Number of cases.
        seed: Seed of the random requests.
        counts: Statuses of the answers, added to.

    Raises:
        Exception: an answer is none that the document knows.
    """
    schema = schemathesis.openapi.from_url(f"{url}/openapi.json")
    operations = [result.ok() for result in schema.get_all_operations()]
    shares = [
        next((share for end, share in SLOW.items() if route.path.endswith(end)), 1.0)
        for route in operations
    ]
    maps = httpx.get(f"{url}/v1/maps", timeout=60).json()["maps"]
    map_id = str(maps[seed % len(maps)]["id"])
    for operation, share in zip(operations, shares, strict=True):
        values = {"id": map_id} if "/maps/{id}" in operation.path else {}
        values |= {name: value for name, value in KNOWN.items() if f"{{{name}}}" in operation.path}
        each = cases * share / sum(shares) / 2
        for mode in (GenerationMode.POSITIVE, GenerationMode.NEGATIVE):
            _ask(operation, mode, values, max(round(each * KNOWN_SHARE), 1), seed, counts)
            # Few cases leave none: to make requests of a kind takes longer than to send a few.
            if unknown_count := round(each * (1.0 - KNOWN_SHARE)):
                _ask(operation, mode, {}, unknown_count, seed, counts)


def _ask(
    operation: Any,
    mode: GenerationMode,
    path: dict[str, str],
    count: int,
    number: int,
    counts: Counter[int],
) -> None:
    try:
        strategy = operation.as_strategy(generation_mode=mode, path_parameters=path or None)
    except schemathesis.errors.InvalidSchema:  # nothing in it can be broken
        return

    @seeded(number)
    @settings(
        max_examples=count,
        phases=[Phase.generate],
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(case=strategy)
    def asked(case: Any) -> None:
        answer = case.call(timeout=120)
        counts[answer.status_code] += 1
        # Requests whose content changed the path or method are not in the document.
        if answer.status_code not in (404, 405, 503):
            case.validate_response(answer, checks=CHECKS)

    try:
        asked()
    except Exception as error:
        if "Unsatisfiable" not in type(error).__name__:
            raise


def main() -> None:
    """Fuzz a server of two small maps, and write the report."""
    from service import serving_app

    args = arguments(__doc__, cases=100_000, seed=0)
    environment = an.environment_from_shapes([shapely.box(0, 0, 6, 3)], name="room")
    scanner = an.RangeScanner.planar(
        sensor=an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01), beams=24, aperture=3.0
    )
    walls = an.environment_from_shapes([shapely.box(0, 0, 6, 3)], name="hall")
    tall = walls.in_space(an.extruded(walls, 2.5))
    maps = [
        an.build_map(building, mounted, spacing=0.25, headings=4, store=False)
        for building, mounted in ((environment, scanner), (tall, scanner.raised(0.3)))
    ]
    begun, counts = time.monotonic(), Counter[int]()
    with serving_app(maps, limits=LIMITS) as url:
        seed = args.seed
        while counts.total() < args.cases:
            fuzz(url, min(ROUND, 2 * (args.cases - counts.total()) + 100), seed, counts)
            seed += 1
            # After each round, so that an interrupted run has a report.
            _write(counts, args, seed, (time.monotonic() - begun) / 60)


def _write(counts: Counter[int], args: argparse.Namespace, seed: int, minutes: float) -> None:
    rows = [(status, f"{count:,}") for status, count in sorted(counts.items())]
    unfinished = "" if counts.total() >= args.cases else " (broken off)"
    body = (
        f"Seeds {args.seed} to {seed - 1}, {minutes:.0f} minutes{unfinished}.\n"
        f"{counts.total():,} requests; none was answered with 500, and each answer but 404, 405 "
        "and 503 was\nchecked against the document.\n\n"
        f"{table(('status', 'requests'), rows, words=0)}"
    )
    report("schemathesis over the OpenAPI document", ("schemathesis",), body, args.out)


if __name__ == "__main__":
    main()
