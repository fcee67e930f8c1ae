"""Kill the service during edits, plans and audits: what it confirmed must be there afterwards.

    python benchmarks/kill_server.py --kills 200 --out benchmarks/results/kill-server.md

Threads post edits of one session, plans and small audits to `ambinav serve --state`, whose process
is killed (SIGKILL) at a random moment, a quarter of the times before it is ready. The next start
must know all that was answered: the steps of the session in their order, every plan and every
audit; results that were seen must be the same. At the end all jobs must have ended.
"""

from __future__ import annotations

import threading
import time
from collections import Counter
from typing import Any

import httpx
import numpy as np
from harness import arguments, report
from service import (
    MAP,
    MAPS_OPTION,
    hall_map,
    poses,
    post_at,
    serving,
    start_and_goal,
    start_audit,
    wait_until_ready,
)

import ambinav as an
from ambinav.server.jobs.state import MOST_PLANS
from ambinav.server.limits import Limits

SESSION = f"{MAP}/sessions/kills"
KEPT = {"plans": MOST_PLANS, "audits": Limits().kept_audits}
"""Results that the server keeps."""
ENDED = ("done", "failed")
READY = 0.75
"""Share of the kills that wait until the server is ready."""


class Confirmed:
    """What the server has confirmed, and what is wrong with what it knows of it."""

    def __init__(self, amap: an.AmbiguityMap, rng: np.random.Generator) -> None:
        self.amap, self.rng = amap, rng
        self.steps: list[str] = []
        self.open: str | None = None
        self.jobs: dict[str, dict[str, Any]] = {}
        self.wrong: list[str] = []
        self.counts: Counter[str] = Counter()
        self._lock = threading.Lock()

    def work(self, kind: str, url: str, end: threading.Event) -> None:
        """Send requests of a kind until the server is gone."""
        with httpx.Client(base_url=url, timeout=60.0) as http:
            while not end.is_set():
                try:
                    getattr(self, kind)(http)
                except httpx.HTTPError:
                    time.sleep(0.05)

    def edit(self, http: httpx.Client) -> None:
        """Post an edit of the session."""
        with self._lock:
            x, y = poses(self.amap, 1, self.rng)
        body = post_at([float(x[0]), float(y[0])])
        answer = http.post(f"{MAP}/edits", params={"session": "kills"}, json=body)
        if answer.status_code == 200:
            with self._lock:
                self.steps.append(answer.json()["id"])
                self.counts["edits"] += 1

    def plan(self, http: httpx.Client) -> None:
        """Start a plan."""
        with self._lock:
            ends = start_and_goal(self.amap, self.rng)
        self._job(http.post(f"{MAP}/plans", json=ends | {"time_s": 0.5}), "plans")

    def audit(self, http: httpx.Client) -> None:
        """Start an audit."""
        self._job(start_audit(http), "audits")
        time.sleep(1.0)

    def _job(self, answer: httpx.Response, kind: str) -> None:
        if answer.status_code == 202:
            with self._lock:
                self.jobs[answer.headers["location"]] = answer.json()
                self.counts[kind] += 1
        else:
            time.sleep(0.2)

    def check(self, http: httpx.Client) -> int:
        """Compare what the server knows with what it confirmed; return the number of open jobs."""
        names = [step["map"] for step in http.get(SESSION).json()["steps"]]
        # The answer to the last edit may have been lost, but not the edit.
        if names[: len(self.steps)] != self.steps or len(names) > len(self.steps) + 1:
            self.wrong.append(f"{len(self.steps)} steps were confirmed, {len(names)} are known")
        self.steps = names
        running = 0
        # Of more results than these the oldest are dropped.
        newest = {
            place
            for kind, count in KEPT.items()
            for place in [name for name in self.jobs if kind in name][-count:]
        }
        for place, before in list(self.jobs.items()):
            answer = http.get(place)
            content = answer.json()
            if answer.status_code == 404 and before["state"] in ENDED and place not in newest:
                del self.jobs[place]
                continue
            if answer.status_code != 200:
                self.wrong.append(f"{place}: {answer.status_code} {answer.text[:100]}")
                continue
            if before["state"] in ENDED and content != before:
                self.wrong.append(f"{place}: {before['state']}, and now another answer")
            self.jobs[place] = content
            running += content["state"] not in ENDED
        return running


def main() -> None:
    """Kill a server, and write the report."""
    args = arguments(__doc__, maps=MAPS_OPTION, kills=200, most=3.0)
    rng = np.random.default_rng(0)
    with hall_map(args.maps) as (scratch, path):
        kept = Confirmed(an.AmbiguityMap.open(path), rng)
        for number in range(args.kills + 1):
            with serving(path, state=scratch / "state") as (url, server):
                with httpx.Client(base_url=url, timeout=120.0) as http:
                    running = kept.check(http)
                    if number == args.kills:
                        while running:
                            time.sleep(1.0)
                            running = kept.check(http)
                        break
                end = threading.Event()
                threads = [
                    threading.Thread(target=kept.work, args=(kind, url, end))
                    for kind in ("edit", "plan", "audit")
                ]
                for thread in threads:
                    thread.start()
                if rng.random() < READY:  # else it is killed while it starts
                    wait_until_ready(url)
                time.sleep(float(rng.uniform(0.1, args.most)))
                server.kill()
                end.set()
                for thread in threads:
                    thread.join()
            print(f"{number + 1} kills, {dict(kept.counts)}, wrong: {len(kept.wrong)}", flush=True)
        states = Counter(job["state"] for job in kept.jobs.values())
        cut = sum("The server ended" in str(job["detail"]) for job in kept.jobs.values())
    lines = [
        f"{args.kills} kills, within {args.most:g} s of the moment when the server was ready, or "
        "had printed its address; confirmed: "
        + ", ".join(f"{count:,} {kind}" for kind, count in sorted(kept.counts.items()))
        + f". Lost or changed: {len(kept.wrong)}.",
        f"Jobs that are still kept: {states['done']} done, {states['failed']} failed, of which "
        f"{cut} were cut off by five kills in a row and say so.",
        *kept.wrong[:20],
    ]
    report("Kills of the service", ("ambinav", "httpx", "uvicorn"), "\n\n".join(lines), args.out)


if __name__ == "__main__":
    main()
