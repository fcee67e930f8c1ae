"""The deviation of walls, `map_std`: the value that orders the poses of real logs best.

As in `bench_real_scans.py`, maps are made of the stretches of a log and judged by the scans of the
others. A larger deviation smooths both what the map predicts and how two real scans are
compared, which alone brings the two nearer. So each deviation of the prediction is held against
scans compared with every deviation: a default is better if its row is, under all columns.
"""

from __future__ import annotations

import argparse
import itertools
from dataclasses import replace

import numpy as np
from bench_real_scans import LOGS, read
from harness import add_out, report, table
from numpy.typing import NDArray
from real_scans.agreement import pose_figures
from real_scans.compared import compared
from real_scans.log_split import as_seen_from_laser, model_of, scanner_of, stretches
from real_scans.rank_agreement import spearman
from real_scans.scan_pairs import scan_pairs

from ambinav.logs.grid_map import map_from_log

STDS = (0.02, 0.03, 0.04, 0.05, 0.07, 0.1)
CELLS = (0.025, 0.05, 0.1)
RANGES = (None, 4.0)
RADIUS, PAIR_RADIUS, STRETCH = 0.5, 1.5, 5.0

Floats = NDArray[np.float64]


def agreement(name: str, max_range: float | None, cell: float) -> Floats:
    """Return rank correlations of the poses' ambiguity: prediction's deviation by the scans'."""
    log = as_seen_from_laser(read(name))
    scanner = scanner_of(log, max_range)
    part = stretches(log, STRETCH)
    predicted: dict[float, list[Floats]] = {std: [] for std in STDS}
    measured: dict[float, list[Floats]] = {std: [] for std in STDS}
    for k in range(2):
        made = map_from_log(log.chosen(part != k), cell)
        pairs = scan_pairs(log, part == k, made, PAIR_RADIUS)
        if not len(pairs):
            continue
        for std in STDS:
            model = replace(model_of(scanner, made, RADIUS), map_std=std)
            both = compared(log, pairs, made, scanner, model)
            predicted[std].append(pose_figures(both.pairs, both.predicted)["ambiguity"])
            measured[std].append(pose_figures(both.pairs, both.measured)["ambiguity"])
    ranks = [
        spearman(np.concatenate(predicted[p]), np.concatenate(measured[m]))
        for p, m in itertools.product(STDS, STDS)
    ]
    return np.array(ranks).reshape(len(STDS), len(STDS))


def main() -> None:
    """Print a table for each cell and range, and the least over all logs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--logs", nargs="+", default=list(LOGS), choices=list(LOGS))
    add_out(parser)
    args = parser.parse_args()
    parts = []
    names = [f"{100 * std:g} cm" for std in STDS]
    for cell, max_range in itertools.product(CELLS, RANGES):
        ranks = np.array([agreement(name, max_range, cell) for name in args.logs])
        reach = "full range" if max_range is None else f"cut at {max_range:g} m"
        rows = []
        for k, name in enumerate(names):
            own = [f"{value:.2f}" for value in ranks[:, k, k]]
            across = [f"{value:.3f}" for value in ranks[:, k].mean(axis=0)]
            rows.append((name, *own, *across))
        header = ("prediction", *args.logs, *(f"mean, scans at {name}" for name in names))
        parts.append(f"## Cells of {100 * cell:g} cm, {reach}\n\n{table(header, rows)}")
        print(parts[-1], flush=True)
    body = (
        "A row for each deviation of the prediction. By log: scans compared with the same "
        "deviation. Then the mean over the logs, scans compared with a fixed deviation.\n\n"
    )
    report("The deviation of walls by real scans", ("ambinav", "numba", "numpy"),
           body + "\n\n".join(parts), args.out)  # fmt: skip


if __name__ == "__main__":
    main()
