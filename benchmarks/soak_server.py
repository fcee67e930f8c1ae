"""Mixed load on the service for a long time: memory, processes, open files, lost requests.

    python benchmarks/soak_server.py --minutes 30 --out benchmarks/results/soak-server.md

Threads ask at random for costs (single, JSON, binary), levels, values, scans, tiles, shapes and
the map itself, plan and give up plans, upload a map and follow or end its audit, and send what is
wrong. A request is lost if its answer is none that it may have. 100 connections are idle.

With `--faults SECONDS` a fault is injected that often: a process for plans or audits is killed, 50
clients send half a request, or one asks for the map 20 times and reads nothing. With `--disk
FOLDER`, a small file system such as a tmpfs of 64 MiB, the state and the scratch files of the
service lie there, and it is also filled for some seconds.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import socket
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import httpx
import numpy as np
import psutil
from harness import arguments, option, report, table
from service import MAP, MAPS_OPTION, hall_map, poses, serving, start_and_goal, start_audit

import ambinav as an

OCTETS = {"content-type": "application/octet-stream"}
IDLE = 100


class Load:
    """Requests of the threads, and their results."""

    def __init__(
        self, url: str, amap: an.AmbiguityMap, until: float, is_faulty: bool, disk: Path | None
    ) -> None:
        self.url, self.amap, self.until, self.is_faulty = url, amap, until, is_faulty
        self.disk, self.full = disk, () if disk is None else (FULL,)
        self.done: Counter[str] = Counter()
        self.lost: list[str] = []
        self._lock = threading.Lock()

    def run(self, seed: int) -> None:
        """Send requests until the time is over."""
        rng = np.random.default_rng(seed)
        kinds = list(SHARES)
        shares = np.array([SHARES[kind] for kind in kinds])
        with httpx.Client(base_url=self.url, timeout=120.0) as http:
            while time.monotonic() < self.until:
                kind = kinds[int(rng.choice(len(kinds), p=shares / shares.sum()))]
                try:
                    problem = getattr(self, kind)(http, rng)
                except Exception as error:
                    problem = f"{type(error).__name__}: {error}"
                with self._lock:
                    self.done[kind] += 1
                    if problem:
                        self.lost.append(f"{kind}: {problem}")

    def single(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request the cost of one pose."""
        x, y = poses(self.amap, 1, rng)
        return expected(http.get(f"{MAP}/cost", params={"x": x[0], "y": y[0]}), 200)

    def batch(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request costs in binary."""
        x, y = poses(self.amap, int(rng.integers(1, 100_000)), rng)
        answer = http.post(f"{MAP}/cost", content=x.tobytes() + y.tobytes(), headers=OCTETS)
        short = answer.status_code == 200 and len(answer.content) != x.nbytes
        return "a short answer" if short else expected(answer, 200)

    def json(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request levels in JSON, at times with a weight."""
        x, y = (part.tolist() for part in poses(self.amap, 500, rng))
        body = {"x": x, "y": y}
        if rng.random() < 0.5:
            return expected(http.post(f"{MAP}/level", json=body), 200)
        return expected(
            http.post(f"{MAP}/cost", json=body | {"weight": float(rng.integers(9))}), 200
        )

    def place(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request values or a scan at a point, as a pointer on the page does."""
        x, y = poses(self.amap, 1, rng)
        query = {"x": x[0], "y": y[0], "theta": float(rng.uniform(0, 6))}
        return expected(http.get(f"{MAP}/{rng.choice(['values', 'scan'])}", params=query), 200)

    def tile(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request a tile."""
        layer = rng.choice(self.amap.layers)
        return expected(http.get(f"{MAP}/layers/{layer}/tiles/0/0/0.png"), 200)

    def whole(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request something of the whole map."""
        name = rng.choice(["zones.geojson", "walls.geojson", "worst", "direction", "map.npz", ""])
        return expected(http.get(f"{MAP}/{name}".rstrip("/")), 200)

    def plan(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request a route; there may be none."""
        body = start_and_goal(self.amap, rng) | {"time_s": 0.3}
        return expected(http.post(f"{MAP}/plan", json=body), 200, 422, 503, *self.full)

    def give_up(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Request a plan and close the connection."""
        body = start_and_goal(self.amap, rng) | {"time_s": 20, "planner": "rrtstar"}
        try:
            answer = http.post(f"{MAP}/plan", json=body, timeout=float(rng.uniform(0.1, 2)))
        except httpx.TimeoutException:
            return None
        return expected(answer, 200, 422, 503, *self.full)

    def audit(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Upload a file for an audit; cancel it at random, or follow it to its end."""
        answer = start_audit(http)
        if answer.status_code != 202:
            return expected(answer, 503, *self.full)
        place = answer.headers["location"]
        if rng.random() < 0.5:
            return expected(http.delete(place), 204)
        stream = http.get(f"{place}/events").text
        ended = "event: done" in stream or (self.is_faulty and "process was killed" in stream)
        ended = ended or (bool(self.full) and "disk" in stream and "full" in stream)
        return None if ended else stream[-200:]

    def faults(self, server: psutil.Process, every: float) -> None:
        """Inject faults until the time is over."""
        rng = np.random.default_rng(99)
        address = httpx.URL(self.url)
        place = address.host, address.port
        lines: list[socket.socket] = []
        while time.monotonic() < self.until:
            time.sleep(every)
            kind = str(rng.choice(["kill", "half", "slow", *(["full"] if self.disk else [])]))
            if self.disk and kind == "full":
                _fill(self.disk, FULL_SECONDS)
            with contextlib.suppress(OSError, psutil.Error):
                if kind == "kill":
                    children = server.children(recursive=True)
                    children[int(rng.integers(len(children)))].kill() if children else None
                for _ in range({"half": 50, "slow": 1}.get(kind, 0)):
                    line = socket.create_connection(place)
                    request = f"GET {MAP}/map.npz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
                    line.sendall(request.encode() * 20 if kind == "slow" else b"GET / HT")
                    lines.append(line)
            with self._lock:
                self.done[f"fault: {kind}"] += 1
        for line in lines:
            line.close()

    def wrong(self, http: httpx.Client, rng: np.random.Generator) -> str | None:
        """Send an invalid request."""
        body = rng.bytes(int(rng.integers(0, 3000)))
        return expected(http.post(f"{MAP}/cost", content=body), 400, 415, 422)


SHARES = {
    "single": 60, "batch": 10, "json": 8, "place": 10, "tile": 10, "whole": 2, "plan": 0.5,
    "give_up": 0.3, "audit": 0.1, "wrong": 3,
}  # fmt: skip
"""Relative frequency of each request."""
FULL = 507
"""Status of what cannot be kept."""
FULL_SECONDS = 3.0


def _fill(disk: Path, seconds: float) -> None:
    """Fill a file system for so long."""
    filler = disk / "filler"
    try:
        with filler.open("wb", buffering=0) as file, contextlib.suppress(OSError):
            while True:
                file.write(b"0" * 65_536)
        time.sleep(seconds)
    finally:
        filler.unlink()


def expected(answer: httpx.Response, *statuses: int) -> str | None:
    """Describe what is wrong with an answer, or return None."""
    if answer.status_code in statuses:
        return None
    return f"{answer.status_code} {answer.text[:200]}"


def main() -> None:
    """Load a server, and write the report."""
    args = arguments(
        __doc__,
        maps=MAPS_OPTION,
        minutes=30.0,
        threads=6,
        faults=0.0,
        disk=option(None, "small file system for the files of the service", type=Path),
    )
    with hall_map(args.maps) as (scratch, path):
        # The server's: nobody tidies it up meanwhile.
        os.environ["TMPDIR"] = str(args.disk or scratch)
        amap = an.AmbiguityMap.open(path)
        log = scratch / "server.log"
        state = None if args.disk is None else args.disk / "state"
        with serving(path, log=log, state=state) as (url, server):
            process = psutil.Process(server.pid)
            address = httpx.URL(url)

            idle = [socket.create_connection((address.host, address.port)) for _ in range(IDLE)]
            load = Load(
                url, amap, time.monotonic() + 60 * args.minutes, args.faults > 0.0, args.disk
            )
            threads = [
                threading.Thread(target=load.run, args=(i,), daemon=True)
                for i in range(args.threads)
            ]
            for thread in threads:
                thread.start()
            if args.faults:
                fault = threading.Thread(target=load.faults, args=(process, args.faults))
                threads.append(fault)
                fault.start()
            rows: list[tuple[object, ...]] = []
            begun = time.monotonic()
            while time.monotonic() < load.until:
                time.sleep(min(60.0 * args.minutes / 12, 60.0))
                rows.append(
                    (
                        f"{(time.monotonic() - begun) / 60:.1f}", f"{load.done.total():,}",
                        f"{process.memory_info().rss / 2**20:.0f}",
                        len(process.children(recursive=True)), process.num_fds(),
                        process.num_threads(),
                    )
                )  # fmt: skip
                # Each time, so that an interrupted run has a report.
                _write(load, rows, log, args, " (broken off)")
            for thread in threads:
                thread.join(300)
            for line in idle:
                line.close()
        _write(load, rows, log, args, "")


def _write(
    load: Load,
    rows: Sequence[tuple[object, ...]],
    log: Path,
    args: argparse.Namespace,
    unfinished: str,
) -> None:
    """Write the report of the results so far."""
    errors = log.read_text().strip()
    counts = ", ".join(f"{count:,} {kind}" for kind, count in load.done.most_common())
    header = ("minute", "requests", "memory, MiB", "processes", "open files", "threads")
    parts = [
        f"{args.threads} threads, {IDLE} idle connections beside them, a fault every "
        f"{args.faults:g} s (0: none){unfinished}.",
        f"{load.done.total():,} requests ({counts}); lost: {len(load.lost)}.\n"
        f"The server's log: {errors[-500:] or 'empty'}.",
        table(header, rows, words=0),
    ]
    if load.lost:
        parts += ["Lost:", "\n".join(f"- {loss}" for loss in load.lost[:20])]
    report("Mixed load", ("ambinav", "httpx", "uvicorn"), "\n\n".join(parts), args.out)


if __name__ == "__main__":
    main()
