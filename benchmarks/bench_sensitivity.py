"""Sensitivity of `level` to the model's parameters, and the values that drives support.

The places and drives are those of `bench_truth.py --folder` (Monte Carlo localization wanders about
each place): how far off the localizer is does not depend on the ambiguity model, so one set of
drives judges every choice. One parameter at a time is changed. Given for each: how far `level`
moves at these places, the area under the curve (AUC) of telling the places where the localizer is
off by more than 0.3 m, and the rank correlation of `level` with its error; for the AUC the mean
over the environments that have five places of both kinds.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from harness import arguments, environment_of, report, table
from numpy.typing import NDArray
from scipy.stats import spearmanr
from truth_case import scanner_of
from truth_tables import BAD, auc

import ambinav as an

FACTORS = {
    "tau": (0.25, 0.5, 1.0, 2.0, 4.0),
    "outlier_share": (0.1, 0.4, 1.0, 2.0, 4.0),
    "map_std": (0.0, 0.5, 1.0, 2.0, 4.0),
    "sigma_theta": (0.5, 1.0, 2.0),
}
"""Times the default."""

Floats = NDArray[np.float64]


def main() -> None:
    """Recompute the levels of all places for each choice, and print the tables."""
    args = arguments(__doc__, folder=Path("out/truth"))
    paths = sorted(args.folder.glob("*_product_map_known_*_drives.jsonl"))
    if not paths:
        sys.exit(f"bench_sensitivity.py: {args.folder} holds no drives; run bench_truth.py first.")
    by_localizer: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for path in paths:
        name, scanner = next(
            (path.name.split(f"_{s}_")[0], s)
            for s in ("laser-30m", "laser-8m", "laser-4m", "sonar-ring", "mixed")
            if f"_{s}_" in path.name
        )
        places = [json.loads(line) for line in path.read_text().splitlines()]
        by_localizer[scanner].append(levels(name, scanner, places))
        print(path.stem, file=sys.stderr, flush=True)
    parts = [str(__doc__).split("\n\n", 1)[1].strip()]
    for scanner, cases in by_localizer.items():
        names = ", ".join(f"{case['name']} ({len(case['error'])} places)" for case in cases)
        parts += [f"## {scanner}", f"Buildings: {names}.", table(HEADER, rows(cases), words=2)]
    report("Sensitivity of the ambiguity level", ["numba", "numpy"], "\n\n".join(parts), args.out)


HEADER = (
    "parameter", "value", "change of level: median", "95 %", "mean, signed", "AUC",
    "rank correlation",
)  # fmt: skip


def levels(name: str, scanner_name: str, places: list[dict[str, float]]) -> dict[str, Any]:
    """Return errors at the places, and their levels for each choice."""
    env = environment_of(name)
    scanner = scanner_of(scanner_name)
    x, y = (np.array([place[key] for place in places]) for key in ("x", "y"))

    def level(**changed: float) -> tuple[Floats, dict[str, float]]:
        amap = an.build_map(env, scanner, **changed, store=False)
        layer = "level_mean" if amap.has_theta else "level"
        model = json.loads(amap.dataset.attrs["parameters"])
        return np.asarray(amap.sample(layer, x, y)), model

    plain, model = level()
    case: dict[str, Any] = {"name": name, "error": np.array([p["error"] for p in places])}
    case["levels"] = {("default", ""): plain}
    for key, factors in FACTORS.items():
        for factor in factors:
            value = max(factor * model[key], 1.0) if key == "tau" else factor * model[key]
            shown = f"{factor:g} x" if key == "tau" else f"{value:g}"
            case["levels"][key, shown] = plain if factor == 1.0 else level(**{key: value})[0]
    return case


def rows(cases: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """Return one row for each choice; choices go by their order, as mappings may differ."""
    lines = []
    for k, (key, shown) in enumerate(cases[0]["levels"]):
        change, scores, ranks = [], [], []
        for case in cases:
            plain, level = case["levels"]["default", ""], list(case["levels"].values())[k]
            error = case["error"]
            is_finite = np.isfinite(level)
            change.append((level - plain)[is_finite])
            scores.append(auc(level[is_finite], error[is_finite] > BAD))
            ranks.append(float(spearmanr(level[is_finite], error[is_finite]).statistic))
        moved = np.concatenate(change)
        shown = shown if len({list(c["levels"])[k] for c in cases}) == 1 else f"{shown} and like"
        lines.append(
            (
                key, shown, f"{np.median(np.abs(moved)):.3f}",
                f"{np.quantile(np.abs(moved), 0.95):.3f}", f"{moved.mean():+.3f}",
                f"{np.nanmean(scores):.3f}" if np.isfinite(scores).any() else "",
                f"{np.mean(ranks):.3f}",
            )
        )  # fmt: skip
    return lines


if __name__ == "__main__":
    main()
