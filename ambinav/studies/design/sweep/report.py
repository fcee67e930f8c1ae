"""Report of a sweep, with scanner.yaml and pictures."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from ambinav.geometry.environment import Environment
from ambinav.maps.zones import ZONES
from ambinav.plotting.sweeps import Curve, Grid, plot_curves, plot_directions, plot_grid
from ambinav.runtime.array_types import Floats
from ambinav.studies.design.sweep.document import FORMAT, Document, document
from ambinav.studies.design.sweep.figures import Figures
from ambinav.studies.design.sweep.sweep import SweepResult
from ambinav.studies.design.sweep.text import (
    Words,
    setting_text,
    share_text,
    values_text,
    varied_text,
    where_text,
)
from ambinav.studies.design.sweep.turning import NOWHERE
from ambinav.studies.design.sweep.vary import VARIABLES
from ambinav.studies.study import Content, Study

SCANNER: Final = "scanner.yaml"
"""The best setting."""
SETTINGS, DIRECTIONS = "settings", "directions"
STUDY: Final = Study(
    "sweep", "ambinav.studies.design.sweep", (SETTINGS, DIRECTIONS), (SCANNER,), FORMAT
)
LISTED: Final = 200
"""Rows that the table of a written report has, the best first; report.json has all."""


def write_report(
    result: SweepResult, env: Environment, folder: str | Path, image_format: str = "png"
) -> Document:
    """Write a sweep, see `Study.write`; return what report.json holds.

    Args:
        result: The sweep.
        env: The building, for its walls.
        folder: Output folder.
        image_format: Format of the pictures, one of `ambinav.plotting.style.FORMATS`.
    """
    report = document(result)
    STUDY.write(folder, content(result, report), pictures(result, env), image_format)
    return report


def pictures(result: SweepResult, env: Environment) -> dict[str, Callable[[], Figure]]:
    """Return the drawing function of each picture, by name."""
    drawn = {SETTINGS: lambda: draw_settings(result)}
    if result.turning is not None and len(result.turning.yaws) > 1:
        drawn[DIRECTIONS] = lambda: draw_directions(result, env)
    return drawn


def draw_settings(result: SweepResult) -> Figure:
    """Draw heat maps for two variations, otherwise curves of each at the others' best values."""
    title = f"{result.scanner.name} in {where_text(result)}"
    if len(result.variations) == 2 and min(result.shape) > 1:
        return plot_grid(_grid(result), title)
    return plot_curves([_curve(result, axis) for axis in range(len(result.variations))], title)


def draw_directions(result: SweepResult, env: Environment) -> Figure:
    """Draw the best direction of the scanner at each place."""
    turning, levels = result.turning, result.levels
    assert turning is not None  # `pictures` asks for it then only
    fits = turning.best != NOWHERE
    yaw = np.radians(np.array(turning.yaws))[turning.best]
    heading = levels.headings[np.maximum(levels.places.heading, 0)]
    angle = np.where(fits, heading + yaw, np.nan)
    gain = np.where(fits, turning.gain_at, np.nan)
    yaw_axis = [variation.name for variation in result.variations].index("yaw")
    others = _other_best_values(result, yaw_axis)
    title = f"Best direction of {result.scanner.name} in {where_text(result)}"
    title += f", with {others}" if others else ""
    return plot_directions(
        env.segments.xy, env.segments.kind, levels.x, levels.y, angle, gain, title
    )


def _label(result: SweepResult, axis: int) -> str:
    variable = VARIABLES[result.variations[axis].name]
    unit = {"deg": " (degrees)", "m": " (m)", "": ""}[variable.unit]
    return f"{variable.title}{unit}"


def _grid_index(result: SweepResult, values: tuple[float, ...]) -> tuple[int, ...] | None:
    """Return the grid index of a setting with these values; None if the grid has no such values."""
    at = []
    for variation, value in zip(result.variations, values, strict=True):
        turn = 360.0 if variation.name == "yaw" else math.inf
        apart = [
            math.nan if math.isnan(value) else abs(math.remainder(value - candidate, turn))
            for candidate in variation.values
        ]
        near = [i for i, gap in enumerate(apart) if gap < 1e-6]
        if not near:
            return None
        at.append(near[0])
    return tuple(at)


def _curve(result: SweepResult, axis: int) -> Curve:
    best = np.unravel_index(result.order[0], result.shape)
    values = np.array(result.variations[axis].values)
    order = np.argsort(values)
    line: list[int | slice] = [int(i) for i in best]
    line[axis] = slice(None)

    def along(read: Callable[[Figures], float]) -> Floats:
        return result.grid(read)[tuple(line)][order]

    zones = [along(partial(_share, zone=zone)) for zone in ZONES]
    others = _other_best_values(result, axis)
    present = result.present.setting.values[axis]
    shown = math.isfinite(present) and values.min() <= present <= values.max()
    return Curve(
        label=_label(result, axis),
        note=f"with {others}" if others else "",
        values=values[order],
        levels={name: along(attrgetter(name)) for name in ("mean", "p95", "worst")},
        zones=np.stack(zones, axis=1),
        best=tuple(float(values[at[axis]]) for at in _twins_along(result, axis)),
        present=present if shown else None,
    )


def _twins_along(result: SweepResult, axis: int) -> list[tuple[int, ...]]:
    """Return grid indices of the best setting's twins that differ in one variation alone."""
    at = _best_indices(result)
    return [
        index
        for index in at
        if index[:axis] + index[axis + 1 :] == at[0][:axis] + at[0][axis + 1 :]
    ]


def _best_indices(result: SweepResult) -> list[tuple[int, ...]]:
    """Return grid indices of the best setting, itself first, and of its twins."""
    at = (np.unravel_index(i, result.shape) for i in result.twins(result.order[0]))
    return [tuple(int(i) for i in index) for index in at]


def _other_best_values(result: SweepResult, axis: int) -> str:
    """Describe the best setting without one variation and those of a single value."""
    texts = zip(result.variations, result.best.setting.values, strict=True)
    return ", ".join(
        VARIABLES[variation.name].text(value)
        for i, (variation, value) in enumerate(texts)
        if i != axis and len(variation.values) > 1
    )


def _share(figures: Figures, zone: str) -> float:
    return figures.zones[zone]


def _grid(result: SweepResult) -> Grid:
    orders = [np.argsort(np.array(variation.values)) for variation in result.variations]
    rank = [np.argsort(order) for order in orders]

    def place(at: tuple[int, ...]) -> tuple[int, int]:
        return int(rank[0][at[0]]), int(rank[1][at[1]])

    panels = (
        ("mean level", result.grid(lambda figures: figures.mean), False),
        ("95th percentile of the level", result.grid(lambda figures: figures.p95), False),
        ("worst level", result.grid(lambda figures: figures.worst), False),
        ("share of corridor and open", result.grid(lambda figures: figures.bad), True),
    )
    present = _grid_index(result, result.present.setting.values)
    return Grid(
        labels=(_label(result, 0), _label(result, 1)),
        values=(
            np.array(result.variations[0].values)[orders[0]],
            np.array(result.variations[1].values)[orders[1]],
        ),
        panels=[(title, values[np.ix_(*orders)], share) for title, values, share in panels],
        best=[place(at) for at in _best_indices(result)],
        present=None if present is None else place(present),
    )


def content(result: SweepResult, report: Document) -> Content:
    """Return what the documents say, and the best scanner."""
    words = Words(result)
    levels, shares = words.formats
    order = result.order[:LISTED]
    rows = [
        (values_text(result, i), report.settings[i], words.margin(i), i in result.as_good[1:])
        for i in order
    ]
    present = tuple(map(varied_text, report.present.values.values()))
    rows.insert(0, (present, report.present, words.margin(None), False))
    turning = None if result.turning is None else words.turning_numbers(result.turning)
    unit = {"m2": "m²", "m": "m"}[result.region.unit]
    values = {
        "unit": unit,
        # Of a sample, an estimate.
        "area_unit": f"about {unit}" if result.levels.places.is_sample else unit,
        "rows": rows,
        "different": len(result.order),
        "gain": None if turning is None else turning.value,
        "fits": result.fits_unevenly,
        "titles": [_label(result, axis) for axis in range(len(result.variations))],
        "best": words.best,
        "next_margin": "" if len(result.order) < 2 else words.margin(result.order[1]),
        "next_name": "" if len(result.order) < 2 else setting_text(result, result.order[1]),
        "present_margin": words.margin(None),
        "best_value": words.best_value,
        "zones": ZONES,
    }
    filters = {
        "level": levels,
        "share": shares,
        "part": share_text,
        "amount": lambda value: "-" if value is None else f"{value:,.1f}",
        "plain": varied_text,
    }
    return Content(report, values, filters, files={SCANNER: report.scanner_yaml})
