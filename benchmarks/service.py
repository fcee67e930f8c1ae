"""The HTTP service for benchmarks: a map, a server in a process or a thread, and its clients."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import numpy as np
from harness import environment_path, option
from lasers import laser

import ambinav as an
from ambinav.server.http.app import create_app
from ambinav.server.http.running import Server
from ambinav.server.limits import Limits

CLIENTS = 8
MAP = "/v1/maps/hall"
"""Address of the map that `hall_map` makes."""
MAPS_OPTION = option(None, "folder in which maps are kept between runs", type=Path)
PLAN = b'{"type": "Polygon", "coordinates": [[[0,0],[9,0],[9,3],[0,3],[0,0]]]}'
"""A building to upload."""


def percentiles(seconds: list[float] | np.ndarray) -> tuple[str, ...]:
    """Return median, 99th percentile and maximum, in milliseconds."""
    ms = 1e3 * np.asarray(seconds)
    return f"{np.median(ms):.2f}", f"{np.percentile(ms, 99):.2f}", f"{ms.max():.2f}"


@contextmanager
def serving(
    *maps: Path,
    log: Path | None = None,
    state: Path | None = None,
    variables: dict[str, str] | None = None,
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run `ambinav serve`; yield its address and its process, which the caller may kill."""
    command = [sys.executable, "-m", "ambinav.cli", "serve", *map(str, maps), "--port", "0"]
    command += [] if state is None else ["--state", str(state)]
    errors = subprocess.DEVNULL if log is None else log.open("w")
    server = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
        env=os.environ | (variables or {}),
    )
    try:
        assert server.stdout is not None
        line = server.stdout.readline()
        if not line:
            raise SystemExit("ambinav serve did not start")
        yield line.split()[0].rstrip("/"), server
    finally:
        server.terminate()
        server.wait(60)


def wait_until_ready(url: str) -> list[float]:
    """Wait until a server is ready; return the seconds of each request for its health meanwhile."""
    health: list[float] = []
    with httpx.Client(base_url=url, timeout=120.0) as http:
        while http.get("/v1/ready").status_code != 200:
            begun = time.perf_counter()
            http.get("/v1/health")
            health.append(time.perf_counter() - begun)
            time.sleep(0.02)
    return health


@contextmanager
def serving_app(maps: list[an.AmbiguityMap], limits: Limits) -> Iterator[str]:
    """Serve maps from a thread of this process with given limits; yield the address."""
    with socket.create_server(("127.0.0.1", 0), backlog=128) as listening:
        app = create_app(maps, limits=limits)
        server = Server(app, log_level="error")
        thread = threading.Thread(target=server.run, args=([listening],))
        thread.start()
        try:
            yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(60)


def make_map(path: Path, building: Path, spacing: float) -> Path:
    """Return the stored ambiguity map of a building for a scanner that sees all around."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        environment = an.load_environment(building)
        an.build_map(environment, laser(), spacing=spacing, store=False).save(path)
    return path


@contextmanager
def hall_map(maps: Path | None) -> Iterator[tuple[Path, Path]]:
    """Yield a folder for files of a run, and the map of a large building.

    Args:
        maps: Folder in which maps are kept between runs; None: the folder of the run.
    """
    with tempfile.TemporaryDirectory() as scratch:
        hall = (maps or Path(scratch)) / "hall.zarr"
        yield Path(scratch), make_map(hall, environment_path("stata_hallways_5cm"), 0.2)


def poses(amap: an.AmbiguityMap, count: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Draw points on the free floor."""
    free = np.argwhere(amap.dataset["free"].values)
    chosen = free[rng.integers(len(free), size=count)]
    shift = rng.uniform(-0.4, 0.4, (2, count)) * amap.spacing
    return (
        amap.dataset["x"].values[chosen[:, 1]] + shift[0],
        amap.dataset["y"].values[chosen[:, 0]] + shift[1],
    )


def start_and_goal(amap: an.AmbiguityMap, rng: np.random.Generator) -> dict[str, Any]:
    """Draw the ends of a plan, as its request names them."""
    start, goal = np.transpose(poses(amap, 2, rng)).tolist()
    return {"start": start, "goal": goal}


def far_ends(amap: an.AmbiguityMap) -> tuple[list[float], list[float]]:
    """Return two distant points of the largest part of the floor, away from walls."""
    from scipy import ndimage

    room = amap.dataset["clearance"].values > 0.5
    labels, _ = ndimage.label(room)
    largest = np.argwhere(labels == np.bincount(labels.ravel())[1:].argmax() + 1)
    first, last = largest[largest.sum(axis=1).argmin()], largest[largest.sum(axis=1).argmax()]
    x, y = amap.dataset["x"].values, amap.dataset["y"].values
    a, b = ([float(x[c]), float(y[r])] for r, c in (first, last))
    return a, b


def post_at(point: list[float]) -> dict[str, Any]:
    """Return an edit that puts a post at a point."""
    feature = {
        "type": "Feature",
        "properties": {"kind": "post", "radius": 0.05},
        "geometry": {"type": "Point", "coordinates": point},
    }
    return {"type": "FeatureCollection", "features": [feature]}


def start_audit(http: httpx.Client) -> httpx.Response:
    """Upload a building for a small audit; return the answer."""
    return http.post(
        "/v1/audits",
        files=[("files", ("room.geojson", PLAN))],
        data={"scanner": "sick-lms200", "spacing": "0.5"},
    )


def request_of(path: str, content: Any = None) -> bytes:
    """Return a GET request, or a POST request with content as JSON, as bytes."""
    if content is None:
        return f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n".encode()
    body = json.dumps(content).encode()
    head = (
        f"POST {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: application/json\r\n"
        f"Content-Length: {len(body)}\r\n\r\n"
    )
    return head.encode() + body


def latencies(url: str, requests: list[bytes], seconds: float, clients: int) -> list[float]:
    """Return latencies of clients that send one request after the other, a connection each."""
    address = urlsplit(url)
    times: list[float] = []

    async def ask(share: list[bytes], until: float) -> None:
        reader, writer = await asyncio.open_connection(address.hostname, address.port)
        number = 0
        while time.perf_counter() < until:
            begun = time.perf_counter()
            writer.write(share[number % len(share)])
            number += 1
            head = await reader.readuntil(b"\r\n\r\n")
            length = int(head.lower().split(b"content-length:")[1].split(b"\r\n")[0])
            await reader.readexactly(length)
            times.append(time.perf_counter() - begun)
            if not head.startswith(b"HTTP/1.1 200"):
                raise SystemExit(head.decode())
        writer.close()

    async def all_clients() -> None:
        until = time.perf_counter() + seconds
        shares = [requests[i::clients] or requests for i in range(clients)]
        await asyncio.gather(*(ask(share, until) for share in shares))

    asyncio.run(all_clients())
    return times
