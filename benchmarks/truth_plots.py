"""Pictures of what `bench_truth.py` found: which layer tells, and how far the radius is right."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# Okabe and Ito's colours, which the colour-blind can tell apart.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
MARKS = ("o", "s", "^", "D", "v")


def scores_picture(
    scanners: list[str], layers: list[str], value: Callable[[str, str], float], path: Path
) -> None:
    """AUC of each layer for each scanner, a dot each; the best layers on top."""
    table = np.array([[value(scanner, name) for scanner in scanners] for name in layers])
    order = np.argsort(np.nanmean(table, axis=1))
    figure, axes = plt.subplots(figsize=(8.0, 4.6), layout="constrained")
    offsets = np.linspace(0.24, -0.24, len(scanners))
    for k, scanner in enumerate(scanners):
        axes.plot(
            table[order, k], np.arange(len(layers)) + offsets[k], MARKS[k], color=COLOURS[k],
            ms=6, label=scanner,
        )  # fmt: skip
    axes.set_yticks(np.arange(len(layers)), [layers[i].replace("_", " ") for i in order])
    for row in range(len(layers)):
        axes.axhspan(row - 0.5, row + 0.5, color="0.95" if row % 2 else "white", zorder=0)
    axes.axvline(0.85, color="0.4", lw=1.0, ls="--")
    axes.text(0.852, -0.45, "goal", fontsize=8, color="0.3", va="bottom")
    axes.set_xlim(min(0.45, float(np.nanmin(table)) - 0.02), 1.005)
    axes.set_ylim(-0.5, len(layers) - 0.5)
    axes.set_xlabel("AUC of telling the bad places, mean over the environments")
    axes.legend(title="scanner", loc="lower left", fontsize=8, title_fontsize=8)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def radius_picture(
    places: dict[str, tuple[Floats, Floats]], name: str, limit: float, path: Path
) -> None:
    """Measured error over predicted radius, a panel a scanner.

    Args:
        places: Predicted radius and measured error of each place, metres, by the scanner.
        name: What the radius is called.
        limit: Above this error a place is bad, metres.
        path: Where the picture goes.
    """
    figure, panels = plt.subplots(
        1, len(places), figsize=(3.0 * len(places), 3.3), sharex=True, sharey=True,
        layout="constrained", squeeze=False,
    )  # fmt: skip
    low, high = 0.003, 3.0
    line = np.array([low, high])
    for panel, (scanner, (radius, error)) in zip(panels[0], places.items(), strict=True):
        panel.fill_between(line, 0.5 * line, 2.0 * line, color="0.88", lw=0, label="factor 2")
        panel.plot(line, line, color="0.5", lw=1.0, label="equal")
        bad = error > limit
        panel.plot(radius[~bad], error[~bad], ".", color=COLOURS[0], ms=3, alpha=0.5,
                   label=f"error up to {limit:g} m")  # fmt: skip
        panel.plot(radius[bad], error[bad], "x", color=COLOURS[1], ms=4, label="above")
        panel.set(xscale="log", yscale="log", xlim=(low, 1.0), ylim=(0.02, high), title=scanner)
        panel.set_xlabel(f"{name}, m")
    panels[0, 0].set_ylabel("measured error, m")
    panels[0, 0].legend(fontsize=7, loc="lower right")
    figure.savefig(path, dpi=150)
    plt.close(figure)
