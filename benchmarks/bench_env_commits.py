"""Steps per second of the navigation environments in several checkouts, in turn.

One process for each checkout; all of them drive the same robots with the same policy, case after
case and round after round. Beside the time on the clock stands that of the processor, which other
programs on the machine hardly change.

    git worktree add ../earlier 8cec7f4
    python benchmarks/bench_env_commits.py ../earlier .
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from harness import add_out, report, spread, table

CASES = ("2048/8/2", "2048/8/1", "2048/64/2", "1/8/1")
"""Robots / procedural buildings / threads."""
PEER = Path(__file__).with_name("peer_env.py")


class Checkout:
    """A process that runs `peer_env.py` with the code of a checkout."""

    def __init__(self, folder: Path, cache: Path) -> None:
        parts = (folder, folder / "envs", folder / "planners")
        path = os.pathsep.join(str(part.resolve()) for part in parts)
        self._process = subprocess.Popen(
            [sys.executable, PEER.resolve()],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=folder,
            env=os.environ | {"PYTHONPATH": path, "AMBINAV_CACHE": str(cache)},
        )  # fmt: skip

    def round(self, case: str) -> tuple[float, float]:
        """Run one round of a case."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{case}\n")
        self._process.stdin.flush()
        elapsed, worked = map(float, self._process.stdout.readline().split())
        return elapsed, worked

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def main() -> None:
    """Measure and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkouts", type=Path, nargs="*", help="the first one is compared with")
    parser.add_argument("--repeats", type=int, default=9)
    add_out(parser)
    args = parser.parse_args()
    names = [
        subprocess.run(
            ["git", "describe", "--always", "--dirty"], cwd=folder, capture_output=True, text=True
        ).stdout.strip()
        or folder.name
        for folder in args.checkouts
    ]
    measured: dict[tuple[str, int], list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as cache:
        peers = [Checkout(folder, Path(cache) / str(k)) for k, folder in enumerate(args.checkouts)]
        # The first round compiles.
        for turn in range(args.repeats + 1):
            for case in CASES:
                for k, peer in enumerate(peers):
                    rates = peer.round(case)
                    if turn:
                        measured.setdefault((case, k), []).append(rates)
        for peer in peers:
            peer.close()
    rows = []
    for case in CASES:
        for k, name in enumerate(names):
            rates, first = measured[case, k], measured[case, 0]
            each = [
                spread([rate[clock] for rate in rates], 1)
                + f", {spread([a[clock] / b[clock] for a, b in zip(rates, first, strict=True)])}"
                for clock in (0, 1)
            ]
            rows.append((*case.split("/"), name, *each))
    header = ("robots", "buildings", "threads", "commit", "elapsed time", "processor time")
    body = (
        "Thousand steps a second by the clock and by the processor's time (of all threads "
        "together), and times those of the first commit in the same round; median and extremes "
        f"over {args.repeats} rounds. 60 beams, Kalman filter, no window.\n\n" + table(header, rows)
    )
    report("Environments of several commits", ("numba", "numpy"), body, args.out)


if __name__ == "__main__":
    main()
