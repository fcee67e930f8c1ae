"""Tables and figure of `bench_ablation.py`."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np
from ablation_effects import (
    CELLS,
    FEWEST,
    INTERACTIONS,
    MAIN,
    MAIN_EFFECTS,
    MAIN_LEVEL,
    MEASURES,
    SECONDARY_LEVEL,
    SHARES,
    SIMPLE,
    TITLED,
    Found,
    against,
    is_marked,
    verdict,
)
from harness import table
from matplotlib.figure import Figure

from ambinav.drive.bootstrap import Interval
from ambinav.plotting.rows import RowChart, draw_point, mark_entry
from ambinav.plotting.style import EFFECTS
from ambinav.reports.table import interval_text

PICTURED: Final = (MAIN, "recorded maps, disturbed")
LETTERS: Final = 24
SHOWN: Final = ("lost", "arrived", "missed", "collided", "timeout", "length", "exposure")
"""Figures of each cell; the exposure shows whether a policy follows the route."""


def attribution(main: Sequence[Found]) -> str:
    """Return one sentence for each effect: with which localizers it helps."""
    lines = []
    for name, effect in MAIN_EFFECTS.items():
        verdicts = {results.localizer: verdict(results, effect) for results in main}
        texts = "; ".join(f"{localizer}: {text}" for localizer, text in verdicts.items())
        in_both = len(verdicts) == 2 and set(verdicts.values()) == {"helps"}
        lines.append(f"- {name}: {texts}" + (": **shown with both localizers**" if in_both else ""))
    return "\n".join(lines)


def main_table(main: Sequence[Found]) -> str:
    """Return the table of the main comparison."""
    rows = []
    for results, (name, effect) in product(main, MAIN_EFFECTS.items()):
        (ours, _), (theirs, _) = sorted(effect.items(), key=lambda term: -term[1])
        seeds = results.differences(effect, "lost")
        rows.append((
            results.localizer, name,
            *(f"{results.figure(cell, 'lost').value:.1f}" for cell in (theirs, ours)),
            text(results.effect(effect, "lost", MAIN_LEVEL), "lost"),
            f"{len(seeds) - against(seeds, -1.0)} of {len(seeds)}",
            interval_text(results.ratio(effect, "lost", 0.95), 2),
            *(text(results.effect(effect, key, 0.95), key) for key in MEASURES[1:]),
            verdict(results, effect),
        ))  # fmt: skip
    header = (
        "localizer", "effect", "lost % without", "with", f"points, {100 * MAIN_LEVEL:.1f} %",
        "seeds below 0", "times as often, 95 %",
        *(f"{TITLED[key].title}, 95 %" for key in MEASURES[1:]),
        "verdict",
    )  # fmt: skip
    return table(header, rows, words=2)


def share_table(main: Sequence[Found]) -> str:
    """Return the table of the parts of the total effect on being lost."""
    rows = []
    for results in main:
        shares = (results.effect(share, "lost", 0.95) for share in SHARES.values())
        rows.append((results.localizer, *(text(share, "lost") for share in shares)))
    return table(("localizer", *SHARES), rows)


def cell_table(setting_results: Sequence[Found]) -> str:
    """Return the figures of all cells of a setting, for each localizer."""
    rows = [
        (results.localizer, cell.reward, cell.weight,
         *(interval_text(results.figure(cell, key), TITLED[key].digits) for key in SHOWN))
        for results in setting_results
        for cell in results.cells
    ]  # fmt: skip
    titles = (f"{TITLED[key].title} {TITLED[key].unit}".strip() for key in SHOWN)
    return table(("localizer", "reward", "weight", *titles), rows, words=2)


def secondary_table(setting_results: Sequence[Found]) -> tuple[str, int, int]:
    """Return all effects of a setting, their number, and how many intervals exclude 0."""
    rows, count, shown = [], 0, 0
    for results, (name, effect) in product(setting_results, (SIMPLE | INTERACTIONS).items()):
        cells = []
        for key in MEASURES:
            value = results.effect(effect, key, SECONDARY_LEVEL)
            count, shown = count + 1, shown + is_marked(results, value)
            bold = "**" if is_marked(results, value) else ""
            cells.append(f"{bold}{text(value, key)}{bold}")
        rows.append((results.localizer, name, *cells))
    header = ("localizer", "effect", *(TITLED[key].title for key in MEASURES))
    return table(header, rows, words=2), count, shown


def seed_table(results: Found, key: str) -> str:
    """Return the table of a measure for each training."""
    rows = []
    for cell in CELLS:
        means = np.nanmean(results.values(cell, key), axis=1)
        rows.append((cell.reward, cell.weight, *(f"{value:.1f}" for value in means)))
    return table(("reward", "weight", *(f"seed {seed}" for seed in results.seeds)), rows)


def text(value: Interval, key: str) -> str:
    """Format a difference and its interval, with signs."""
    return interval_text(value, TITLED[key].digits, "+")


def body(settings: Sequence[Found]) -> str:
    """Return the tables of a report, the main comparison first."""
    names = list(dict.fromkeys(results.setting for results in settings))
    by_name = {name: [results for results in settings if results.setting == name] for name in names}
    main = by_name[MAIN]
    parts = [
        f"## Main comparison: ever lost, {MAIN}", main_table(main), attribution(main),
        "The whole effect of `ambiguity` with its route, and the shares of it, points, 95 %:",
        share_table(main),
    ]  # fmt: skip
    tables = {name: secondary_table(setting_results) for name, setting_results in by_name.items()}
    count = sum(number for _, number, _ in tables.values())
    shown = sum(number for _, _, number in tables.values())
    parts += [
        "## Secondary: all effects",
        "Differences in points of per cent, of the length ratio in its own unit; intervals of "
        f"{100 * SECONDARY_LEVEL:g} %, each by itself. In bold, {shown} of {count}: what misses 0, "
        "as one in a hundred would by chance; eight of them are those of the main comparison. Of "
        f"fewer than {FEWEST} replicates nothing is in bold.",
    ]
    for name, (rows, _, _) in tables.items():
        parts += [f"### {name.capitalize()}", rows]
    parts.append("## All cells, intervals of 95 %")
    for name, setting_results in by_name.items():
        parts += [f"### {name.capitalize()}", cell_table(setting_results)]
    parts.append(f"## Each training, ever lost %, {MAIN}")
    for results in main:
        parts += [f"### {results.localizer}", seed_table(results, "lost")]
    return "\n\n".join(parts)


def plot_effects(settings: Sequence[Found]) -> Figure:
    """Plot effects on being lost and on arriving, for both localizers, halls and recorded maps."""
    panels = [(setting, key) for setting in PICTURED for key in ("lost", "arrived")]
    by_case = {(item.setting, item.localizer): item for item in settings}
    localizers = list(dict.fromkeys(item.localizer for item in settings))
    rows = list(product(localizers, SIMPLE.items()))
    counts = {item.localizer: len(item.seeds) for item in settings}
    chart = RowChart(
        [(f"{name}, {counts[name]} seeds", effect) for name, (effect, _) in rows],
        [1.0] * len(panels),
        "What the reward does, and what the route does (disturbed; points, intervals of 99 %)",
        12.0, LETTERS,
    )  # fmt: skip
    for axes, (setting, key) in zip(chart.panels, panels, strict=True):
        for at, (localizer, (_, effect)) in zip(chart.places, rows, strict=True):
            results = by_case[setting, localizer]
            value = results.effect(effect, key, SECONDARY_LEVEL)
            good = (value.value > 0.0) == (key == "arrived")
            look = ("met" if good else "worse") if is_marked(results, value) else "none"
            draw_point(axes, at, value, EFFECTS[look])
        axes.axvline(0.0, color="#333333", linewidth=0.8, linestyle=":", zorder=1)
        axes.set_xlabel(f"{TITLED[key].title}, {setting.partition(',')[0]}")
    handles = [
        mark_entry(EFFECTS[look], label)
        for look, label in (("met", "better"), ("none", "not shown"), ("worse", "worse"))
    ]
    chart.figure.legend(handles=handles, loc="outside lower left", frameon=False, ncol=3)
    return chart.figure
