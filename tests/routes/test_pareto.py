"""The front over weights: dominance, its table, and its picture."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.text import Annotation

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting.pareto import plot_pareto
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.pareto import ParetoFront, ParetoPoint
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from tests.maps import synthetic

BASE = evaluate_route(
    AmbiguityService(AmbiguityMap(synthetic.dataset())),
    [(1.0, 2.0, 0.0), (9.0, 2.0, 0.0)],
    Steering(),
    planner="by hand",
)


def front(*points: tuple[float, float, float]) -> ParetoFront:
    """A front of made-up (weight, length, exposure)."""
    return ParetoFront(
        tuple(
            ParetoPoint(weight, replace(BASE, length=length, exposure=exposure))
            for weight, length, exposure in points
        )
    )


def test_points_come_by_weight_and_length_counts_from_the_shortest():
    found = front((5, 11.0, 2.0), (0, 10.0, 6.0), (1, 10.5, 4.0))
    assert [point.weight for point in found.points] == [0, 1, 5]
    assert found.shortest.length == 10.0
    assert found.extra == pytest.approx((0.0, 0.05, 0.1))
    assert found.dominated == (False, False, False)


def test_dominated_means_another_is_no_worse_in_both_and_better_in_one():
    assert front((0, 10, 6), (1, 11, 4), (5, 12, 4)).dominated == (False, False, True)
    assert front((0, 10, 6), (1, 10, 5)).dominated == (True, False)
    assert front((0, 10, 6), (1, 10, 6)).dominated == (False, False)
    # Rounding in the integrals makes no difference.
    assert front((0, 10, 6), (1, 10 + 1e-13, 6 - 1e-13)).dominated == (False, False)


@given(st.lists(st.tuples(st.integers(1, 20), st.integers(0, 20)), min_size=1, max_size=12))
def test_dominance_agrees_with_its_definition(values):
    found = front(*((float(i), float(a), float(b)) for i, (a, b) in enumerate(values)))
    expected = tuple(
        any(a2 <= a and b2 <= b and (a2, b2) != (a, b) for a2, b2 in values) for a, b in values
    )
    assert found.dominated == expected
    assert not all(found.dominated)


def test_table_in_both_formats(tmp_path):
    found = front((0, 10.0, 6.0), (5, 11.0, 2.0), (9, 12.0, 2.0))
    found.save(tmp_path / "front.csv")
    found.save(tmp_path / "front.json")
    with (tmp_path / "front.csv").open() as file:
        table = list(csv.DictReader(file))
    objects = json.loads((tmp_path / "front.json").read_text())
    assert len(table) == len(objects) == 3
    assert [float(row["extra_percent"]) for row in table] == pytest.approx([0.0, 10.0, 20.0])
    assert [row["dominated"] for row in table] == ["0", "0", "1"]
    assert [row["dominated"] for row in objects] == [False, False, True]
    assert list(table[0]) == list(objects[0])
    assert objects[1]["bad_m"] == BASE.bad_metres
    assert objects[1]["corridor_m"] == BASE.corridor_metres
    assert objects[1]["longest_corridor_m"] == BASE.longest_corridor > 4.0
    assert objects[1]["open_m"] == objects[1]["longest_open_m"] == 0.0


def test_unusable_fronts(tmp_path):
    with pytest.raises(InputError, match="points is empty"):
        ParetoFront(())
    with pytest.raises(InputError, match=r"'\.xlsx'"):
        front((0, 1, 1)).save(tmp_path / "front.xlsx")


def with_floor(route, corridor, longest_corridor, wide, longest_open):
    """The route with other metres in corridor and in open zones."""
    zones = {**route.zone_metres, "corridor": corridor, "open": wide}
    return replace(
        route, zone_metres=zones, longest_corridor=longest_corridor, longest_open=longest_open
    )


def labels(axes) -> list[Annotation]:
    return [text for text in axes.texts if isinstance(text, Annotation)]


@pytest.mark.slow
def test_picture_labels_every_weight_and_joins_equal_points():
    found = front((0, 10, 6), (1, 10.4, 4), (2, 11, 2), (3, 11, 2), (5, 11, 2), (8, 12, 2))
    figure = plot_pareto(found)
    for axes in figure.axes:
        assert "%" in axes.get_xlabel()
        assert "(m)" in axes.get_ylabel()
    shown = [label.get_text() for label in labels(figure.axes[0])]
    assert shown == ["0", "1", "2 – 5", "8"]  # noqa: RUF001 (a range is written with a dash)
    solid, hollow = figure.axes[0].lines
    assert solid.get_xdata().tolist() == pytest.approx([0, 4, 10, 10, 10])
    assert hollow.get_xdata().tolist() == pytest.approx([20])


@pytest.mark.slow
def test_picture_tells_corridor_and_open_zones_apart():
    floors = ((8.0, 5.0, 3.0, 3.0), (4.0, 2.0, 0.5, 0.25), (1.0, math.nan, 0.0, 0.0))
    found = ParetoFront(
        tuple(
            ParetoPoint(point.weight, with_floor(point.route, *floor))
            for point, floor in zip(
                front((0, 10, 6), (1, 11, 4), (5, 12, 2)).points, floors, strict=True
            )
        )
    )
    figure = plot_pareto(found)
    for axes, column, title in zip(figure.axes[1:], (0, 2), ("corridor", "open"), strict=True):
        assert axes.get_ylabel() == f"length in {title} zones (m)"
        metres, _, longest = axes.lines
        assert metres.get_ydata().tolist() == [floor[column] for floor in floors]
        due = [floor[column + 1] for floor in floors]
        assert longest.get_ydata().tolist() == pytest.approx(due, nan_ok=True)
    (legend,) = figure.legends
    assert "longest stretch" in [text.get_text() for text in legend.get_texts()]


@pytest.mark.slow(kept=("2.0",))
@pytest.mark.parametrize("bend", [0.5, 2.0, 8.0])
def test_labels_overlap_nothing(bend):
    weights = [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0]
    share = [np.exp(-weight / bend) for weight in weights]
    found = front(*((w, 30 + 3 * (1 - s), 3 + 6 * s) for w, s in zip(weights, share, strict=True)))
    found = ParetoFront(
        tuple(
            ParetoPoint(p.weight, with_floor(p.route, 2 + 9 * s, 1 + 4 * s, 5 * s * s, 4 * s * s))
            for p, s in zip(found.points, share, strict=True)
        )
    )
    figure = plot_pareto(found)
    figure.canvas.draw()
    for axes in figure.axes:
        assert_apart(axes)


def assert_apart(axes):
    """No label of some axes overlaps another one, or reaches out of them."""
    inside = axes.get_window_extent()
    # The text alone, without the line that may lead to it.
    boxes = [super(Annotation, label).get_window_extent() for label in labels(axes)]
    for i, box in enumerate(boxes):
        assert box.count_overlaps([b for j, b in enumerate(boxes) if j != i]) == 0
        assert inside.x0 <= box.x0 and box.x1 <= inside.x1
        assert inside.y0 <= box.y0 and box.y1 <= inside.y1


def test_one_route_alone_can_be_drawn():
    figure = plot_pareto(front((3, 10.0, 0.0)), title="A title")
    assert figure.get_suptitle() == "A title"
    assert [label.get_text() for label in labels(figure.axes[0])] == ["3"]
