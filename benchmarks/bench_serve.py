"""Performance of the HTTP service: batches, single queries, tiles, and both during a plan.

    python benchmarks/bench_serve.py --data DIR --out benchmarks/results/serve.md

`ambinav serve` runs in a process of its own; the clients run in this one. Every latency is from
the first byte sent to the last byte read.
"""

from __future__ import annotations

import argparse
import asyncio
import http.client
import os
import platform
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np

import ambinav as an
from ambinav.server.http.app import create_app
from ambinav.server.http.running import Server
from ambinav.server.limits import Limits

BATCH = 100_000
CLIENTS = 8


def percentiles(seconds: list[float] | np.ndarray) -> str:
    """Return median, 99th percentile and maximum, in milliseconds."""
    ms = 1e3 * np.asarray(seconds)
    return f"{np.median(ms):.2f} | {np.percentile(ms, 99):.2f} | {ms.max():.2f}"


@contextmanager
def serving(*maps: Path, log: Path | None = None) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run `ambinav serve`; yield its address and its process."""
    command = [sys.executable, "-m", "ambinav.cli", "serve", *map(str, maps), "--port", "0"]
    errors = subprocess.DEVNULL if log is None else log.open("w")
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
    try:
        assert server.stdout is not None
        line = server.stdout.readline()
        if not line:
            raise SystemExit("ambinav serve did not start")
        yield line.split()[0].rstrip("/"), server
    finally:
        server.terminate()
        server.wait(60)


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
        scanner = an.RangeScanner.planar(
            sensor=an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001),
            beams=60,
            aperture=2 * np.pi,
        )
        environment = an.load_environment(building)
        an.build_map(environment, scanner, spacing=spacing, store=False).save(path)
    return path


def poses(amap: an.AmbiguityMap, count: int, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Draw points on the free floor."""
    free = np.argwhere(amap.dataset["free"].values)
    chosen = free[rng.integers(len(free), size=count)]
    shift = rng.uniform(-0.4, 0.4, (2, count)) * amap.spacing
    return (
        amap.dataset["x"].values[chosen[:, 1]] + shift[0],
        amap.dataset["y"].values[chosen[:, 0]] + shift[1],
    )


def overhead(amap: an.AmbiguityMap, rounds: int, rng: np.random.Generator) -> str:
    """Return a batch's cost in the service over that of its kernel, alternating in one process."""
    from ambinav.maps.lattice_values import values_at
    from ambinav.runtime.threads import run_rows

    service = an.AmbiguityService(amap)
    x, y = poses(amap, BATCH, rng)
    field, zeros, out = service.density, np.zeros(BATCH), np.empty(BATCH)
    possible = field.free[:, :, np.newaxis] if field.possible is None else field.possible
    given = (field.values, possible, *field.origin, 1.0 / field.spacing, np.inf, out)

    def kernel() -> None:
        run_rows(values_at, BATCH, x, y, zeros, *given, least=2048)

    spent: dict[Callable[[], object], list[float]] = {kernel: [], lambda: service.cost(x, y): []}
    for _ in range(rounds + 3):
        for work, times in spent.items():
            begun = time.perf_counter()
            work()
            times.append(time.perf_counter() - begun)
    plain, full = (np.array(times[3:]) for times in spent.values())
    low = np.median(full) / np.median(plain) - 1, full.min() / plain.min() - 1
    return (
        f"| kernel | {1e3 * np.median(plain):.3f} | {1e3 * plain.min():.3f} |\n"
        f"| service | {1e3 * np.median(full):.3f} | {1e3 * full.min():.3f} |\n"
        f"| more | {100 * low[0]:.1f} % | {100 * low[1]:.1f} % |\n"
    )


def batches(url: str, map_id: str, x: np.ndarray, y: np.ndarray, rounds: int) -> str:
    """Measure batches over a plain connection, and by `ambinav.Client`."""
    address = urlsplit(url)
    line = http.client.HTTPConnection(str(address.hostname), address.port)
    body, headers = x.tobytes() + y.tobytes(), {"Content-Type": "application/octet-stream"}

    def plain() -> None:
        line.request("POST", f"/v1/maps/{map_id}/cost?columns=x,y", body, headers)
        np.frombuffer(line.getresponse().read())

    rows = ""
    with an.Client(url, map_id) as client:
        for name, work in (("plain", plain), ("Client", lambda: client.cost(x, y))):
            times = []
            for _ in range(rounds + 3):
                begun = time.perf_counter()
                work()
                times.append(time.perf_counter() - begun)
            rate = len(x) / np.array(times[3:]) / 1e6
            low, middle, high = np.percentile(rate, [10, 50, 90])
            rows += f"| {name} | {middle:.2f} | {low:.2f} to {high:.2f} |\n"
    line.close()
    return rows


async def _ask(
    address: tuple[str, int], paths: list[bytes], until: float, times: list[float]
) -> None:
    reader, writer = await asyncio.open_connection(*address)
    number = 0
    while time.perf_counter() < until:
        path = paths[number % len(paths)]
        number += 1
        begun = time.perf_counter()
        writer.write(b"GET " + path + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        head = await reader.readuntil(b"\r\n\r\n")
        length = int(head.lower().split(b"content-length:")[1].split(b"\r\n")[0])
        await reader.readexactly(length)
        times.append(time.perf_counter() - begun)
        if not head.startswith(b"HTTP/1.1 200"):
            raise SystemExit(head.decode())
    writer.close()


def latencies(url: str, paths: list[bytes], seconds: float, clients: int) -> list[float]:
    """Return latencies of clients that send one request after the other, a connection each."""
    address = urlsplit(url)
    place = str(address.hostname), int(address.port or 0)
    times: list[float] = []

    async def all_clients() -> None:
        until = time.perf_counter() + seconds
        shares = [paths[i::clients] or paths for i in range(clients)]
        await asyncio.gather(*(_ask(place, share, until, times) for share in shares))

    asyncio.run(all_clients())
    return times


@contextmanager
def a_plan(
    url: str, map_id: str, ends: tuple[list[float], list[float]], seconds: float
) -> Iterator[None]:
    """Run a plan in the background."""
    body = f'{{"start": {ends[0]}, "goal": {ends[1]}, "planner": "rrtstar", "time_s": {seconds}}}'
    address = urlsplit(url)
    line = http.client.HTTPConnection(str(address.hostname), address.port, timeout=seconds + 60)
    status = []

    def ask() -> None:
        line.request("POST", f"/v1/maps/{map_id}/plan", body, {"Content-Type": "application/json"})
        answer = line.getresponse()
        status.append((answer.status, answer.read()[:200]))

    thread = threading.Thread(target=ask)
    thread.start()
    yield
    thread.join()
    line.close()
    if status[0][0] != 200:
        raise SystemExit(f"the plan failed: {status[0]}")


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


def tile_paths(map_id: str, amap: an.AmbiguityMap) -> list[bytes]:
    """Return all tiles of four layers, both statistics."""
    from ambinav.server.tiles.pyramid import TILE, depth_of

    ny, nx = amap.dataset["free"].shape
    depth = depth_of((ny, nx))
    paths = []
    for layer in ("level", "zone", "major_radius", "direction"):
        for stat in ("mean", "worst"):
            for z in range(depth + 1):
                side = TILE * 2 ** (depth - z)
                for ty in range(-(-ny // side)):
                    for tx in range(-(-nx // side)):
                        paths.append(
                            f"/v1/maps/{map_id}/layers/{layer}/tiles/{z}/{tx}/{ty}.png"
                            f"?stat={stat}".encode()
                        )
    return paths


def main() -> None:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("AMBINAV_DATA", ".")))
    parser.add_argument("--maps", type=Path, help="folder in which maps are kept between runs")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=10.0)
    options = parser.parse_args()
    rng = np.random.default_rng(0)
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.maps or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        maps = options.data / "maps"
        hall = make_map(folder / "hall.zarr", maps / "stata_hallways_5cm.yaml", 0.2)
        huge = make_map(folder / "huge.zarr", maps / "stata_tiled_2x9_huge.yaml", 0.5)
        small, large = an.AmbiguityMap.open(hall), an.AmbiguityMap.open(huge)
        x, y = poses(small, BATCH, rng)
        text = f"""# The HTTP service

`python {" ".join(sys.argv)}`, {platform.processor() or platform.machine()}, {os.cpu_count()} cores,
load {load:.1f} before; server and clients on the same cores.

## In process: cost of {BATCH:,} poses, ms

|  | median | least |
| --- | ---: | ---: |
{overhead(small, options.rounds, rng)}
"""
        with serving(hall, huge) as (url, _):
            text += f"""## Batches of {BATCH:,} poses over loopback, million poses a second

| client | median | 10th to 90th percentile |
| --- | ---: | ---: |
{batches(url, "hall", x, y, options.rounds)}
"""
            single = [
                f"/v1/maps/hall/cost?x={a:.4f}&y={b:.4f}".encode()
                for a, b in zip(x[:4000].tolist(), y[:4000].tolist(), strict=True)
            ]
            latencies(url, single, 1.0, CLIENTS)
            rows = ""
            times = latencies(url, single, options.seconds, CLIENTS)
            rows += f"| alone | {len(times) / options.seconds:,.0f} | {percentiles(times)} |\n"
            with a_plan(url, "hall", far_ends(small), options.seconds + 5):
                times = latencies(url, single, options.seconds, CLIENTS)
            rows += (
                f"| while a plan runs | {len(times) / options.seconds:,.0f} | "
                f"{percentiles(times)} |\n"
            )
            text += f"""## Single queries, {CLIENTS} clients

|  | a second | median, ms | 99th percentile | most |
| --- | ---: | ---: | ---: | ---: |
{rows}
"""
            paths = tile_paths("huge", large)
            rng.shuffle(paths)
            latencies(url, [path for path in paths if b"/0/0/0.png" in path], 0.5, 1)
            first, again = [], []
            address = urlsplit(url)
            line = http.client.HTTPConnection(str(address.hostname), address.port)
            for times in (first, again):
                for path in paths:
                    begun = time.perf_counter()
                    line.request("GET", path.decode())
                    answer = line.getresponse()
                    answer.read()
                    times.append(time.perf_counter() - begun)
                    assert answer.status == 200, path
            line.close()
            text += f"""## Tiles of stata_tiled_2x9_huge, spacing 0.5 m: {len(paths)}, one client

|  | median, ms | 99th percentile | most |
| --- | ---: | ---: | ---: |
| encoded | {percentiles(first)} |
| kept | {percentiles(again)} |
"""
    if options.out is None:
        print(text)
    else:
        options.out.write_text(text)


if __name__ == "__main__":
    main()
