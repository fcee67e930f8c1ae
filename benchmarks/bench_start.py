"""Start of the service: when it answers, when it is ready, and its first answers.

    python benchmarks/bench_start.py --out benchmarks/results/start.md

`ambinav serve` starts twice: with an empty folder for machine code, and with the one that it has
filled. While it gets ready its health is asked for every 20 ms. Then each kind of request is sent
for the first time, and by 8 clients for some seconds; and 500 clients send half a request.
"""

from __future__ import annotations

import contextlib
import socket
import time
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
from harness import arguments, report, table
from service import (
    CLIENTS,
    MAP,
    MAPS_OPTION,
    far_ends,
    hall_map,
    latencies,
    percentiles,
    post_at,
    request_of,
    serving,
    wait_until_ready,
)

import ambinav as an

HALF_OPEN = 500
Request = tuple[str, Any]


def requests(amap: an.AmbiguityMap) -> dict[str, Request]:
    """Return one request of each kind that does not start a job: address and what it posts."""
    (x, y), _ = far_ends(amap)
    pose = {"x": [x], "y": [y], "theta": [0.0]}
    step = {"x0": [x], "y0": [y], "x1": [x + 0.3], "y1": [y], "theta0": [0.0], "theta1": [0.5]}
    curve = {"steering": "reeds-shepp", "turning_radius": 0.3}
    return {
        "health": ("/v1/health", None),
        "startup": ("/v1/startup", None),
        "ready": ("/v1/ready", None),
        "metrics": ("/v1/metrics", None),
        "scanners": ("/v1/scanners", None),
        "maps": ("/v1/maps", None),
        "map": (MAP, None),
        "map.npz": (f"{MAP}/map.npz", None),
        "cost": (f"{MAP}/cost?x={x}&y={y}", None),
        "costs": (f"{MAP}/cost", pose),
        "levels": (f"{MAP}/level", pose),
        "rewards": (f"{MAP}/reward", step),
        "rewards of curves": (f"{MAP}/reward", step | curve),
        "values": (f"{MAP}/values?x={x}&y={y}", None),
        "scan": (f"{MAP}/scan?x={x}&y={y}", None),
        "worst places": (f"{MAP}/worst", None),
        "tile": (f"{MAP}/layers/level/tiles/0/0/0.png", None),
        "layer": (f"{MAP}/layers/level", None),
        "directions": (f"{MAP}/direction", None),
        "zones": (f"{MAP}/zones.geojson", None),
        "walls": (f"{MAP}/walls.geojson", None),
        "building": (f"{MAP}/building.geojson", None),
        "obstacles": (f"{MAP}/obstacles.geojson", None),
    }


def half_open(url: str) -> float:
    """Return the seconds after which the last of 500 connections with half a request is closed."""
    place = urlsplit(url)
    with contextlib.ExitStack() as stack:
        begun = time.perf_counter()
        address = str(place.hostname), int(place.port or 0)
        lines = [stack.enter_context(socket.create_connection(address)) for _ in range(HALF_OPEN)]
        for line in lines:
            line.sendall(b"GET /v1/health HT")
        for line in lines:
            line.settimeout(120.0)
            if line.recv(1) != b"":
                raise SystemExit("half a request was answered")
        return time.perf_counter() - begun


def main() -> None:
    """Measure and write the report."""
    args = arguments(__doc__, maps=MAPS_OPTION, seconds=2.0)
    with hall_map(args.maps) as (scratch, path):
        amap = an.AmbiguityMap.open(path)
        starts: list[tuple[object, ...]] = []
        rows: list[tuple[object, ...]] = []
        for name in ("empty", "filled"):
            begun = time.perf_counter()
            with serving(path, variables={"NUMBA_CACHE_DIR": str(scratch / "code")}) as (url, _):
                answers = time.perf_counter() - begun
                health = wait_until_ready(url)
                ready = time.perf_counter() - begun
                starts.append((name, f"{answers:.1f}", f"{ready:.1f}", *percentiles(health)))
                if name == "empty":
                    continue
                a, b = far_ends(amap)
                jobs: dict[str, Request] = {
                    "plan": (f"{MAP}/plan", {"start": a, "goal": b}),
                    "edit": (f"{MAP}/edits", post_at(a)),
                }
                first: dict[str, float] = {}
                with httpx.Client(base_url=url, timeout=120.0) as http:
                    for kind, (address, body) in (requests(amap) | jobs).items():
                        method = "GET" if body is None else "POST"
                        before = time.perf_counter()
                        http.request(method, address, json=body).raise_for_status()
                        first[kind] = time.perf_counter() - before
                for kind, request in requests(amap).items():
                    times = latencies(url, [request_of(*request)], args.seconds, CLIENTS)
                    rate = f"{len(times) / args.seconds:,.0f}"
                    rows.append((kind, f"{1e3 * first[kind]:.1f}", *percentiles(times), rate))
                closed = half_open(url)
                rows += [(kind, f"{1e3 * first[kind]:.1f}", "", "", "", "") for kind in jobs]
    worst = max(float(str(row[3])) for row in rows if row[3])
    parts = [
        "Server and clients on the same cores; the map is stata_hallways_5cm with cells of 0.2 m "
        f"({int(np.prod(amap.dataset['free'].shape)):,} cells).",
        table(
            (
                "machine code",
                "answers after, s",
                "ready after, s",
                "health: median, ms",
                "p99",
                "most",
            ),
            starts,
        ),
        f"The first answer after the server was ready, and {CLIENTS} clients for "
        f"{args.seconds:g} s each; the largest 99th percentile is {worst:.1f} ms. A plan and an "
        "edit are jobs.",
        table(("request", "first, ms", "median, ms", "p99", "most", "a second"), rows),
        f"{HALF_OPEN} connections with half a request were closed after {closed:.1f} s.",
    ]
    report("Start of the service", ("ambinav", "numba", "uvicorn"), "\n\n".join(parts), args.out)


if __name__ == "__main__":
    main()
