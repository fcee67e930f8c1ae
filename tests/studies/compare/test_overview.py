"""The picture that leads a report: what its bars of corridor and open zones say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_rgba

from ambinav.maps.zones import CORRIDOR, OPEN
from ambinav.plotting.style import ZONE_COLOURS
from ambinav.routes.bad_floor import BadFloor
from ambinav.studies.compare.overview import PALE, plot_overview
from ambinav.studies.compare.tables import Row, make_rows
from tests.studies.compare.test_tables import CASES

FLOORS = (BadFloor(20.0, 15.0, 3.0, 3.0), BadFloor(2.0, 1.5, 0.0, 0.0))


def rows_with(*floors: BadFloor) -> list[Row]:
    rows = make_rows(*zip(*CASES[:2], strict=True), "shortest", 1)
    return [replace(row, floor=floor) for row, floor in zip(rows, floors, strict=True)]


@pytest.mark.slow
def test_each_zone_has_a_bar_and_its_longest_stretch_is_in_full_colour() -> None:
    axes = plot_overview(rows_with(*FLOORS), "a title").axes[-1]
    bars = {
        (round(bar.get_y() + 0.5 * bar.get_height()), bar.get_facecolor()): bar.get_width()
        for bar in axes.patches
        if bar.get_width()
    }
    corridor, wide = (ZONE_COLOURS[zone] for zone in (CORRIDOR, OPEN))
    assert bars == {
        (1, to_rgba(corridor, PALE)): 20.0,
        (1, to_rgba(corridor)): 15.0,
        (1, to_rgba(wide, PALE)): 3.0,
        (1, to_rgba(wide)): 3.0,
        (2, to_rgba(corridor, PALE)): 2.0,
        (2, to_rgba(corridor)): 1.5,
    }
    assert axes.get_xlim()[1] > 20.0


@pytest.mark.slow
@pytest.mark.parametrize("walls", [0, 10])
def test_nothing_overlaps(walls: int) -> None:
    cases = [
        (plan, replace(found, metrics=replace(found.metrics, collided=np.arange(30) < walls)))
        for plan, found in CASES[:2]
    ]
    figure = plot_overview(make_rows(*zip(*cases, strict=True), "shortest", 1), "a title")
    figure.canvas.draw()
    assert len(figure.axes) == (5 if walls else 4)
    boxes = [axes.xaxis.label.get_window_extent() for axes in figure.axes]
    boxes += [legend.get_window_extent() for legend in figure.legends]
    for i, box in enumerate(boxes):
        assert box.count_overlaps([b for j, b in enumerate(boxes) if j != i]) == 0
        assert box.x0 >= 0.0 and box.x1 <= figure.bbox.x1
