"""Performance of the HTTP service: batches, single queries, tiles, and both during a plan.

`ambinav serve` runs in a process of its own; the clients run in this one. Every latency is from
the first byte sent to the last byte read.
"""

from __future__ import annotations

import http.client
import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from urllib.parse import urlsplit

import numpy as np
from harness import arguments, data_file, report, table, timed
from service import (
    CLIENTS,
    MAPS_OPTION,
    far_ends,
    hall_map,
    latencies,
    make_map,
    percentiles,
    poses,
    request_of,
    serving,
)

import ambinav as an

BATCH = 100_000


def overhead(amap: an.AmbiguityMap, rounds: int, rng: np.random.Generator) -> str:
    """Return a batch's cost in the service over that of its kernel, alternating in one process."""
    from ambinav.maps.lattice_values import values_at
    from ambinav.runtime.threads import run_rows

    service = an.AmbiguityService(amap)
    x, y = poses(amap, BATCH, rng)
    field, zeros, out = service.density, np.zeros(BATCH), np.empty(BATCH)
    possible = field.free[:, :, np.newaxis] if field.possible is None else field.possible
    arguments = (field.values, possible, *field.origin, 1.0 / field.spacing, np.inf, out)

    def kernel() -> None:
        run_rows(values_at, BATCH, x, y, zeros, *arguments, least=2048)

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


@contextmanager
def a_plan(
    url: str, map_id: str, ends: tuple[list[float], list[float]], seconds: float
) -> Iterator[None]:
    """Run a plan in the background."""
    ask_for = {"start": ends[0], "goal": ends[1], "planner": "rrtstar", "time_s": seconds}
    body = json.dumps(ask_for)
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


def tile_paths(map_id: str, amap: an.AmbiguityMap) -> list[str]:
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
                            f"/v1/maps/{map_id}/layers/{layer}/tiles/{z}/{tx}/{ty}.png?stat={stat}"
                        )
    return paths


def main() -> None:
    """Measure and write the report."""
    args = arguments(__doc__, maps=MAPS_OPTION, rounds=100, seconds=10.0)
    rng = np.random.default_rng(0)
    with hall_map(args.maps) as (_, hall):
        building = data_file("maps/stata_tiled_2x9_huge.yaml")
        huge = make_map(hall.with_name("huge.zarr"), building, 0.5)
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
                request_of(f"/v1/maps/hall/cost?x={a:.4f}&y={b:.4f}")
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
            first = [request_of(path) for path in paths if "/0/0/0.png" in path]
            latencies(url, first, 0.5, 1)
            address = urlsplit(url)
            line = http.client.HTTPConnection(str(address.hostname), address.port)

            def ask(path: str) -> None:
                line.request("GET", path)
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
