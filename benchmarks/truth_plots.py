"""Figures of `bench_truth.py`: the layers' scores, and the radius against the error."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ambinav.plotting.canvas import new_figure, save_figure
from ambinav.plotting.style import MARKS, SERIES

Floats = NDArray[np.float64]


def scores_picture(
    layers: list[str], scores: dict[str, dict[str, list[float]]], goal: float | None, path: Path
) -> None:
    """Plot the AUC of each layer for each scanner, the best on top; no figure without layers.

    Args:
        layers: Their names.
        scores: AUC of the layers, nan where there is none, by the panel and the scanner.
        goal: Value of the criterion; drawn as a line.
        path: File of the picture.
    """
    values = np.array([list(panel.values()) for panel in scores.values()])
    has_value = np.isfinite(values).any(axis=(0, 1))
    if not has_value.any():
        return
    mean = np.nanmean(values[:, :, has_value], axis=(0, 1))
    order = np.flatnonzero(has_value)[np.argsort(mean)]
    names = [layers[i].replace("_", " ") for i in order]
    figure = new_figure(3.6 + 4.4 * len(scores), 4.6)
    panels = figure.subplots(1, len(scores), sharex=True, sharey=True, squeeze=False)
    scored = [
        s for k, s in enumerate(next(iter(scores.values()))) if np.isfinite(values[:, k]).any()
    ]
    offsets = np.linspace(0.24, -0.24, len(scored))
    for axes, (title, panel) in zip(panels[0], scores.items(), strict=True):
        for k, scanner in enumerate(scored):
            axes.plot(
                np.array(panel[scanner])[order], np.arange(len(order)) + offsets[k], MARKS[k],
                color=SERIES[k], ms=6, label=scanner,
            )  # fmt: skip
        for row_number in range(len(order)):
            shade = "0.95" if row_number % 2 else "white"
            axes.axhspan(row_number - 0.5, row_number + 0.5, color=shade, zorder=0)
        if goal is not None:
            axes.axvline(goal, color="0.4", lw=1.0, ls="--")
            axes.text(goal + 0.002, -0.45, "criterion", fontsize=8, color="0.3", va="bottom")
        axes.set_title(title)
        axes.set_xlabel("AUC of recognising bad places, mean over the environments")
    panels[0, 0].set_yticks(np.arange(len(order)), names)
    panels[0, 0].set_xlim(min(0.45, float(np.nanmin(values)) - 0.02), 1.005)
    panels[0, 0].set_ylim(-0.5, len(order) - 0.5)
    handles, called = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, called, title="scanner", loc="outside right upper")
    save_figure(figure, path)


def radius_picture(
    places: dict[str, tuple[Floats, Floats]], name: str, limit: float, path: Path
) -> None:
    """Plot measured error over predicted radius, one panel a scanner.

    Args:
        places: Predicted radius and measured error of each place, metres, by the scanner.
        name: Name of the radius.
        limit: Above this error a place is bad, metres.
        path: File of the picture.
    """
    figure = new_figure(3.0 * len(places), 3.3)
    panels = figure.subplots(1, len(places), sharex=True, sharey=True, squeeze=False)
    low, high = 0.003, 3.0
    line = np.array([low, high])
    for panel, (scanner, (radius, error)) in zip(panels[0], places.items(), strict=True):
        panel.fill_between(line, 0.5 * line, 2.0 * line, color="0.88", lw=0, label="factor 2")
        panel.plot(line, line, color="0.5", lw=1.0, label="equal")
        bad = error > limit
        panel.plot(radius[~bad], error[~bad], ".", color=SERIES[0], ms=3, alpha=0.5,
                   label=f"error up to {limit:g} m")  # fmt: skip
        panel.plot(radius[bad], error[bad], "x", color=SERIES[1], ms=4, label="above")
        panel.set(xscale="log", yscale="log", xlim=(low, 1.0), ylim=(0.02, high), title=scanner)
        panel.set_xlabel(f"{name}, m")
    panels[0, 0].set_ylabel("measured error, m")
    handles, called = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, called, loc="outside lower center", ncols=len(handles), fontsize=8)
    save_figure(figure, path)
