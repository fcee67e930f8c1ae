"""Tables of `bench_truth.py`: how well layers predict where localizers err."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from harness import table
from numpy.typing import NDArray
from scipy.stats import rankdata, spearmanr

from ambinav.maps.zones import CORRIDOR, ZONES

LAYERS = {
    "level": 1, "position_radius": 1, "major_radius": 1, "ambiguity": 1, "fisher": 1,
    "localizability": 1,
    "coastal_entropy": 1, "gfm": 1, "wall_normals": -1, "perturbation": 1, "clearance": 1,
    "aliasing": 1, "aliasing_area": 1,
}  # fmt: skip
"""Layers, and 1 where a high value means badly localized."""
RADIUS = "position_radius"
METRES = (RADIUS, "major_radius", "fisher", "localizability", "perturbation")
SHOWN = ("level", RADIUS, "ambiguity", "fisher", "coastal_entropy")
"""Layers shown for each environment, before them `aliasing` where the start is unknown."""
AXES = ("direction", "fisher_direction", "localizability_direction", "perturbation_direction")
BAD = 0.3
GOAL = 0.85
FEWEST = 5
DRAWS = 1000
ODOMETRY = "odometry of 9 degrees and 11 cm in a metre"

Floats = NDArray[np.float64]
Place = dict[str, Any]
Case = tuple[str, str]
Found = dict[Case, list[Place]]
Groups = dict[tuple[str, str], list[list[Place]]]
"""Places of each environment, by scanner and localizer."""


def column(places: Sequence[Place], name: str) -> Floats:
    """Return a figure of all places; nan where it is missing."""
    return np.array([place.get(name, np.nan) for place in places], dtype=np.float64)


def scores(places: Sequence[Place], name: str) -> Floats:
    """Return a layer at all places, signed so that high is bad; unknown values count as bad."""
    values = LAYERS[name] * column(places, name)
    return np.where(np.isnan(values), np.inf, values)


def auc(score: Floats, bad: NDArray[np.bool_]) -> float:
    """Return the share of (bad, good) pairs that the score orders; nan with too few of either."""
    ours, good = int(bad.sum()), int((~bad).sum())
    if min(ours, good) < FEWEST:
        return float("nan")
    ranks = rankdata(score)
    return float((ranks[bad].sum() - ours * (ours + 1) / 2) / (ours * good))


def body(by_localizer: dict[str, Found], unknown: bool, when: str) -> str:
    """Return the report's tables; radii and axes do not apply to robots without a start pose."""
    scanners = list(
        dict.fromkeys(scanner for places in by_localizer.values() for _, scanner in places)
    )
    pairs = [(scanner, name) for scanner in scanners for name in by_localizer]
    groups = {(scanner, name): places_of(by_localizer[name], scanner) for scanner, name in pairs}
    columns = [f"{scanner}, {name}" for scanner, name in pairs]
    first = ("aliasing",) if unknown else ()
    of_errors = ("runs that miss themselves",) if unknown else ("error, median", "error, 95 %")
    parts = [f"## Places driven about{when}"]
    rows = [
        [*case, name, len(p), int(column(p, "bad").sum()), *spread_of(p, unknown)]
        for name, places in by_localizer.items()
        for case, p in places.items()
    ]
    rows.sort(key=lambda row: (scanners.index(row[1]), row[0]))
    header = ("environment", "scanner", "localizer", "places", "bad", *of_errors)
    parts.append(table(header, rows, words=3))
    parts += [f"### Bad places among those in each zone{when}", by_zone(groups)]
    for title, figure in (("AUC", auc_of), ("Rank correlation with the error", rank_of)):
        parts.append(f"## {title}{when}, mean over the environments")
        rows = []
        for name in LAYERS:
            cells = [mean_of(group, name, figure) for group in groups.values()]
            values = [value for value in cells if not np.isnan(value)]
            if values:
                mean = float(np.mean(values))
                rows.append([name, *[_cell(value) for value in cells], _cell(mean)])
        parts.append(table(("layer", *columns, "all"), rows))
    parts.append(f"## AUC by environment{when}")
    rows = [
        [*case, name, *[_cell(auc_of(places, layer)) for layer in (*first, *SHOWN)]]
        for name, every in by_localizer.items()
        for case, places in every.items()
        if np.isfinite(auc_of(places, "level"))
    ]
    rows.sort(key=lambda row: (scanners.index(row[1]), row[0]))
    parts.append(table(("environment", "scanner", "localizer", *first, *SHOWN), rows, words=3))
    for ours in (*first, "level", RADIUS):
        parts.append(f"## AUC of `{ours}`{when} less that of the others, intervals of 95 %")
        rows = [
            [name, *[difference(group, ours, name) for group in groups.values()]]
            for name in LAYERS
            if name != ours
        ]
        parts.append(table(("layer", *columns), [row for row in rows if any(row[1:])]))
    parts += [f"## In words{when}", in_words(groups, when)]
    if unknown:
        return "\n\n".join(parts)
    parts.append("## Measured error by predicted radius, median (and quartiles)")
    parts.append(table(("layer", *columns), [calibration(groups, name) for name in METRES]))
    parts.append("## Angle to the measured weak axis in corridor zones, median degrees (places)")
    parts.append(table(("layer", *columns), [angles(groups, name) for name in AXES]))
    return "\n\n".join(parts)


def by_zone(groups: Groups) -> str:
    """Return how many places are bad in each zone of the map, of how many."""
    rows = []
    for (scanner, name), place_lists in groups.items():
        places = [place for group in place_lists for place in group]
        cells = []
        for code in range(len(ZONES)):
            bad = [place["bad"] for place in places if place.get("zone") == code]
            cells.append(f"{sum(bad)} of {len(bad)}")
        rows.append([scanner, name, *cells])
    return table(("scanner", "localizer", *ZONES), rows, words=2)


def in_words(groups: Groups, when: str) -> str:
    """Return the best layers in sentences with their conditions."""
    lines = []
    for (scanner, name), place_lists in groups.items():
        usable = [group for group in place_lists if np.isfinite(auc_of(group, "level"))]
        if not usable:
            continue
        values = {layer: mean_of(usable, layer, auc_of) for layer in LAYERS}
        best = sorted((layer for layer in values if values[layer] > 0.0), key=lambda k: -values[k])
        beside = next(layer for layer in ("level", *best[1:]) if layer != best[0])
        shown = [*best[:2], *[k for k in ("level", RADIUS) if k in best[2:]]]
        buildings = "1 building" if len(usable) == 1 else f"{len(usable)} buildings"
        lines.append(
            f"- {scanner}, {ODOMETRY}, `{name}`{when}, {buildings} with enough bad and "
            f"good places, {sum(map(len, usable))} places: AUC of "
            + ", ".join(f"`{layer}` {values[layer]:.2f}" for layer in shown)
            + f"; `{best[0]}` less `{beside}` {difference(usable, best[0], beside)}."
        )
    return "\n".join(lines) or "There are too few bad places."


def spread_of(places: Sequence[Place], unknown: bool) -> list[str]:
    """Return the size of an environment's errors."""
    error = column(places, "error")
    if unknown:
        return [f"{100.0 * error.mean():.0f} %"]
    return [f"{np.median(error):.3f} m", f"{np.quantile(error, 0.95):.2f} m"]


def places_of(places_by_case: Found, scanner: str) -> list[list[Place]]:
    """Return the places of a scanner, by environment."""
    return [
        places
        for (_, scanner_of_case), places in places_by_case.items()
        if scanner_of_case == scanner and places
    ]


def _cell(value: float) -> str:
    return "" if np.isnan(value) else f"{value:.3f}"


def auc_of(places: Sequence[Place], name: str) -> float:
    """Return the AUC of a layer."""
    return auc(scores(places, name), column(places, "bad") > 0.0)


def rank_of(places: Sequence[Place], name: str) -> float:
    """Return the rank correlation of a layer with the error; nan where the layer is constant."""
    score = scores(places, name)
    if np.ptp(rankdata(score)) == 0.0:
        return float("nan")
    return float(spearmanr(rankdata(score), column(places, "error")).statistic)


def mean_of(groups: list[list[Place]], name: str, figure: Any) -> float:
    """Return the mean of a figure over the environments that have it; nan without the layer."""
    if not groups or not any(name in place for group in groups for place in group):
        return float("nan")
    values = np.array([figure(group, name) for group in groups])
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


def difference(groups: list[list[Place]], ours: str, name: str, seed: int = 3) -> str:
    """Return one layer's AUC minus another's, with environments and places resampled."""
    usable = [g for g in groups if np.isfinite(auc_of(g, ours)) and name in g[0]]
    if not usable:
        return ""
    rng = np.random.default_rng(seed)
    data = [(scores(g, ours), scores(g, name), column(g, "bad") > 0.0) for g in usable]
    values = []
    for _ in range(DRAWS):
        sample = []
        for k in rng.integers(len(data), size=len(data)):
            first, second, bad = data[k]
            rows = rng.integers(len(bad), size=len(bad))
            sample.append(auc(first[rows], bad[rows]) - auc(second[rows], bad[rows]))
        if np.isfinite(sample).any():
            values.append(np.nanmean(sample))
    low, high = np.quantile(values, (0.025, 0.975))
    middle = np.mean([auc(a, c) - auc(b, c) for a, b, c in data])
    return f"{middle:+.3f} ({low:+.3f} to {high:+.3f})"


def calibration(groups: Groups, name: str) -> list[str]:
    """Return the quartiles of the ratio of error to prediction."""
    cells = [name]
    for place_lists in groups.values():
        places = [place for group in place_lists for place in group]
        ratio = column(places, "error") / column(places, name)
        ratio = ratio[np.isfinite(ratio)]
        if not len(ratio):
            cells.append("")
            continue
        low, middle, high = np.quantile(ratio, (0.25, 0.5, 0.75))
        cells.append(f"{middle:.2f} ({low:.2f} to {high:.2f})")
    return cells


def angles(groups: Groups, name: str) -> list[str]:
    """Return the angle between the predicted and the true weak axis."""
    cells = [name]
    for place_lists in groups.values():
        places = [place for group in place_lists for place in group]
        long = column(places, "error_major") >= 2.0 * column(places, "error_minor")
        axis = column(places, name)
        chosen = long & (column(places, "zone") == CORRIDOR) & np.isfinite(axis)
        if not chosen.any():
            cells.append("")
            continue
        off = np.abs((axis - column(places, "error_axis") + np.pi / 2) % np.pi - np.pi / 2)
        cells.append(f"{np.degrees(np.median(off[chosen])):.1f} ({int(chosen.sum())})")
    return cells
