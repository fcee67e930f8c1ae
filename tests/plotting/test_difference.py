"""The picture of a difference: its colours stay apart, and each panel shows what it is to show."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_hex

from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.difference import ChangeLayer, plot_difference
from tests.maps import synthetic
from tests.plotting.test_maps import byte
from tests.plotting.test_style import apart, lab

SCALE = [to_hex(colormaps[style.CHANGE](share)) for share in np.linspace(0.0, 1.0, 9)]


def test_better_and_worse_are_told_apart_by_everybody():
    for better, worse in zip(SCALE[:4], SCALE[:4:-1], strict=True):
        assert apart(better, worse) > 10.0
    # From the middle to either end it gets darker.
    light = [lab(colour)[0] for colour in SCALE]
    assert light[:5] == sorted(light[:5]) and light[4:] == sorted(light[4:], reverse=True)


def test_new_and_gone_are_told_apart_and_from_the_scale():
    assert apart(style.NEW, style.GONE) > 10.0
    assert apart(style.NEW_FLOOR, style.GONE_FLOOR) > 10.0
    around = (SCALE[4], style.UNKNOWN, style.SOLID, style.UNREACHABLE)
    for tint, other in product((style.NEW_FLOOR, style.GONE_FLOOR), around):
        assert apart(tint, other) > 7.0


@pytest.fixture
def drawn():
    amap = AmbiguityMap(synthetic.dataset())
    shape = amap.dataset["free"].shape
    rise = np.where(amap.dataset["free"].values, 0.0, np.nan)
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    rise[(x < 2) & np.isfinite(rise)] = 0.5
    rise[(x > 20) & np.isfinite(rise)] = -0.5
    new, gone = np.zeros(shape, dtype=bool), np.zeros(shape, dtype=bool)
    new[(x > 6) & (x < 8) & (y > 1) & (y < 3)] = True
    gone[(x > 10) & (x < 12) & (y > 1) & (y < 3)] = True
    rise[new | gone] = np.nan
    change = ChangeLayer(
        amap.bounds, rise, new, gone,
        np.array([[17.0, 5.0, 19.0, 5.0]]), np.array([[17.0, 8.0, 19.0, 8.0]]),
    )  # fmt: skip
    parts = amap.judged
    title = "a scanner with a very long name " * 4
    return plot_difference(amap, amap, (parts, parts), change, (f"A: {title}", "B"))


@pytest.mark.slow
def test_the_third_panel_shows_the_change(drawn):
    first, second, third = drawn.axes[:3]
    drawn.canvas.draw()
    pixels = np.asarray(drawn.canvas.buffer_rgba())

    def colour_at(axes, x: float, y: float) -> tuple[int, int, int]:
        column, row = axes.transData.transform((x, y))
        return tuple(pixels[pixels.shape[0] - 1 - int(row), int(column), :3].tolist())

    for axes in (first, second):
        assert colour_at(axes, 1.0, 2.0) == byte(style.ZONE_COLOURS[0])
        assert colour_at(axes, 21.0, 5.0) == byte(style.ZONE_COLOURS[3])
    red, blue = colour_at(third, 1.0, 2.0), colour_at(third, 21.0, 5.0)
    assert red[0] > 2 * red[2] and blue[2] > 2 * blue[0]
    assert min(colour_at(third, 5.0, 2.0)) > 240  # the same in both
    assert colour_at(third, 7.0, 2.0) == byte(style.NEW_FLOOR)
    assert colour_at(third, 11.0, 2.0) == byte(style.GONE_FLOOR)
    assert colour_at(third, 18.0, 5.0) == byte(style.NEW)
    labels = {text.get_text() for text in third.get_legend().get_texts()}
    assert labels == {"new floor", "floor gone", "new wall", "wall gone"}


@pytest.mark.slow
def test_long_titles_stay_over_their_panel(drawn):
    drawn.canvas.draw()
    axes = drawn.axes[0]
    title = next(text for text in axes.findobj() if str(getattr(text, "_text", ""))[:2] == "A:")
    assert title.get_window_extent().width <= 1.05 * axes.get_window_extent().width
