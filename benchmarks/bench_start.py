"""Start of the service: when it answers, when it is ready, and its first answers.

    python benchmarks/bench_start.py --out benchmarks/results/start.md

`ambinav serve` starts twice: with an empty folder for machine code, and with the one that it has
filled. While it gets ready its health is asked for every 20 ms. Then each kind of request is sent
for the first time, and by 8 clients for some seconds; and 500 clients send half a request.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
from bench_serve import CLIENTS, far_ends, make_map, percentiles
from harness import arguments, environment_path, option, report, table

import ambinav as an

MAP = "/v1/maps/hall"
HALF_OPEN = 500
Request = tuple[str, str, Any]


def requests(amap: an.AmbiguityMap) -> dict[str, Request]:
    """Return one request of each kind that does not start a job: method, address, body."""
    (x, y), _ = far_ends(amap)
    pose = {"x": [x], "y": [y], "theta": [0.0]}
    step = {"x0": [x], "y0": [y], "x1": [x + 0.3], "y1": [y], "theta0": [0.0], "theta1": [0.5]}
    curve = {"steering": "reeds-shepp", "turning_radius": 0.3}
    return {
        "maps": ("GET", "/v1/maps", None),
        "map": ("GET", MAP, None),
        "cost": ("GET", f"{MAP}/cost?x={x}&y={y}", None),
        "costs": ("POST", f"{MAP}/cost", pose),
        "levels": ("POST", f"{MAP}/level", pose),
        "rewards": ("POST", f"{MAP}/reward", step),
        "rewards of curves": ("POST", f"{MAP}/reward", step | curve),
        "values": ("GET", f"{MAP}/values?x={x}&y={y}", None),
        "scan": ("GET", f"{MAP}/scan?x={x}&y={y}", None),
        "worst places": ("GET", f"{MAP}/worst", None),
        "tile": ("GET", f"{MAP}/layers/level/tiles/0/0/0.png", None),
        "directions": ("GET", f"{MAP}/direction", None),
        "metrics": ("GET", "/v1/metrics", None),
    }


def started(path: Path, cache: Path) -> tuple[subprocess.Popen[str], str, list[object]]:
    """Start a server; return it, its address, and times until then, until ready and of health."""
    command = [sys.executable, "-m", "ambinav.cli", "serve", str(path), "--port", "0"]
    begun = time.perf_counter()
    environment = os.environ | {"NUMBA_CACHE_DIR": str(cache)}
    server = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    assert server.stdout is not None
    url = server.stdout.readline().split()[0].rstrip("/")
    answers = time.perf_counter() - begun
    health: list[float] = []
    with httpx.Client(base_url=url, timeout=120.0) as http:
        while http.get("/v1/ready").status_code != 200:
            before = time.perf_counter()
            http.get("/v1/health")
            health.append(time.perf_counter() - before)
            time.sleep(0.02)
    ready = time.perf_counter() - begun
    return server, url, [f"{answers:.1f}", f"{ready:.1f}", *percentiles(health)]


async def _ask(address: tuple[str, int], head: bytes, until: float, times: list[float]) -> None:
    reader, writer = await asyncio.open_connection(*address)
    while time.perf_counter() < until:
        before = time.perf_counter()
        writer.write(head)
        answer = await reader.readuntil(b"\r\n\r\n")
        await reader.readexactly(int(answer.lower().split(b"content-length:")[1].split()[0]))
        times.append(time.perf_counter() - before)
        if not answer.startswith(b"HTTP/1.1 200"):
            raise SystemExit(answer.decode())
    writer.close()


def by_many(url: str, request: Request, seconds: float) -> list[float]:
    """Return latencies of clients that send a request one after the other."""
    method, path, content = request
    body = b"" if content is None else json.dumps(content).encode()
    head = (
        f"{method} {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    ).encode() + body
    place = urlsplit(url)
    times: list[float] = []

    async def all_clients() -> None:
        until = time.perf_counter() + seconds
        address = str(place.hostname), int(place.port or 0)
        await asyncio.gather(*(_ask(address, head, until, times) for _ in range(CLIENTS)))

    asyncio.run(all_clients())
    return times


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
    args = arguments(
        __doc__,
        maps=option(None, "folder in which maps are kept between runs", type=Path),
        seconds=2.0,
    )
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.maps or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        path = make_map(folder / "hall.zarr", environment_path("stata_hallways_5cm"), 0.2)
        amap = an.AmbiguityMap.open(path)
        starts: list[tuple[object, ...]] = []
        rows: list[tuple[object, ...]] = []
        for name in ("empty", "filled"):
            server, url, times = started(path, Path(scratch) / "code")
            starts.append((name, *times))
            try:
                with httpx.Client(base_url=url, timeout=120.0) as http:
                    if name == "empty":
                        continue
                    a, b = far_ends(amap)
                    first: dict[str, float] = {}
                    edit = {"type": "FeatureCollection", "features": [_post(a)]}
                    jobs: dict[str, Request] = {
                        "plan": ("POST", f"{MAP}/plan", {"start": a, "goal": b}),
                        "edit": ("POST", f"{MAP}/edits", edit),
                    }
                    for kind, (method, address, body) in (requests(amap) | jobs).items():
                        before = time.perf_counter()
                        http.request(method, address, json=body).raise_for_status()
                        first[kind] = time.perf_counter() - before
                for kind, request in requests(amap).items():
                    times_of = by_many(url, request, args.seconds)
                    rate = f"{len(times_of) / args.seconds:,.0f}"
                    rows.append((kind, f"{1e3 * first[kind]:.1f}", *percentiles(times_of), rate))
                closed = half_open(url)
                rows += [(kind, f"{1e3 * first[kind]:.1f}", "", "", "", "") for kind in jobs]
            finally:
                server.terminate()
                server.wait(60)
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


def _post(at: list[float]) -> dict[str, object]:
    return {
        "type": "Feature",
        "properties": {"kind": "post", "radius": 0.05},
        "geometry": {"type": "Point", "coordinates": at},
    }


if __name__ == "__main__":
    main()
