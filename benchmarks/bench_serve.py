"""Performance of the HTTP service: batches, single queries, tiles, and both during a plan.

`ambinav serve` runs in a process of its own; the clients run in this one. Every latency is from
the first byte sent to the last byte read.
"""

from __future__ import annotations

import asyncio
import http.client
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from harness import arguments, data_file, environment_path, option, report, table, timed
from lasers import laser

import ambinav as an
from ambinav.server.http.app import create_app
from ambinav.server.http.running import Server
from ambinav.server.limits import Limits

BATCH = 100_000
CLIENTS = 8


def percentiles(seconds: list[float] | np.ndarray) -> tuple[str, ...]:
    """Return median, 99th percentile and maximum, in milliseconds."""
    ms = 1e3 * np.asarray(seconds)
    return f"{np.median(ms):.2f}", f"{np.percentile(ms, 99):.2f}", f"{ms.max():.2f}"


@contextmanager
def serving(
    *maps: Path, log: Path | None = None, state: Path | None = None
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run `ambinav serve`; yield its address and its process."""
    command = [sys.executable, "-m", "ambinav.cli", "serve", *map(str, maps), "--port", "0"]
    command += [] if state is None else ["--state", str(state)]
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
        environment = an.load_environment(building)
        an.build_map(environment, laser(), spacing=spacing, store=False).save(path)
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
    rows = [
        (name, *(f"{1e3 * value:.3f}" for value in (np.median(times), times.min())))
        for name, times in (("kernel", plain), ("service", full))
    ]
    return table(("", "median", "least"), [*rows, ("more", *(f"{100 * v:.1f} %" for v in low))])


def batches(url: str, map_id: str, x: np.ndarray, y: np.ndarray, rounds: int) -> str:
    """Measure batches over a plain connection, and by `ambinav.Client`."""
    address = urlsplit(url)
    line = http.client.HTTPConnection(str(address.hostname), address.port)
    body, headers = x.tobytes() + y.tobytes(), {"Content-Type": "application/octet-stream"}

    def plain() -> None:
        line.request("POST", f"/v1/maps/{map_id}/cost?columns=x,y", body, headers)
        np.frombuffer(line.getresponse().read())

    rows = []
    with an.Client(url, map_id) as client:
        for name, work in (("plain", plain), ("Client", lambda: client.cost(x, y))):
            times = []
            for _ in range(rounds + 3):
                begun = time.perf_counter()
                work()
                times.append(time.perf_counter() - begun)
            rate = len(x) / np.array(times[3:]) / 1e6
            low, middle, high = np.percentile(rate, [10, 50, 90])
            rows.append((name, f"{middle:.2f}", f"{low:.2f} to {high:.2f}"))
    line.close()
    return table(("client", "median", "10th to 90th percentile"), rows)


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
    args = arguments(
        __doc__,
        maps=option(None, "folder in which maps are kept between runs", type=Path),
        rounds=100,
        seconds=10.0,
    )
    rng = np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as scratch:
        folder = args.maps or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        hall = make_map(folder / "hall.zarr", environment_path("stata_hallways_5cm"), 0.2)
        huge = make_map(folder / "huge.zarr", data_file("maps/stata_tiled_2x9_huge.yaml"), 0.5)
        small, large = an.AmbiguityMap.open(hall), an.AmbiguityMap.open(huge)
        x, y = poses(small, BATCH, rng)
        parts = [
            "Server and clients on the same cores.",
            f"## In process: cost of {BATCH:,} poses, ms",
            overhead(small, args.rounds, rng),
        ]
        with serving(hall, huge) as (url, _):
            parts.append(f"## Batches of {BATCH:,} poses over loopback, million poses a second")
            parts.append(batches(url, "hall", x, y, args.rounds))
            single = [
                f"/v1/maps/hall/cost?x={a:.4f}&y={b:.4f}".encode()
                for a, b in zip(x[:4000].tolist(), y[:4000].tolist(), strict=True)
            ]
            latencies(url, single, 1.0, CLIENTS)
            alone = latencies(url, single, args.seconds, CLIENTS)
            with a_plan(url, "hall", far_ends(small), args.seconds + 5):
                beside = latencies(url, single, args.seconds, CLIENTS)
            parts.append(f"## Single queries, {CLIENTS} clients")
            rows = [
                (name, f"{len(times) / args.seconds:,.0f}", *percentiles(times))
                for name, times in (("alone", alone), ("while a plan runs", beside))
            ]
            parts.append(table(("", "a second", "median, ms", "99th percentile", "most"), rows))
            paths = tile_paths("huge", large)
            rng.shuffle(paths)
            latencies(url, [path for path in paths if b"/0/0/0.png" in path], 0.5, 1)
            address = urlsplit(url)
            line = http.client.HTTPConnection(str(address.hostname), address.port)

            def ask(path: bytes) -> None:
                line.request("GET", path.decode())
                answer = line.getresponse()
                answer.read()
                assert answer.status == 200, path

            rows = [
                (name, *percentiles([timed(partial(ask, path))[0] for path in paths]))
                for name in ("encoded", "kept")
            ]
            line.close()
        parts.append(f"## Tiles of stata_tiled_2x9_huge, spacing 0.5 m: {len(paths)}, one client")
        parts.append(table(("", "median, ms", "99th percentile", "most"), rows))
    report("The HTTP service", ("ambinav", "numpy", "uvicorn"), "\n\n".join(parts), args.out)


if __name__ == "__main__":
    main()
