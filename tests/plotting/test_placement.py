"""The picture of a placement: every obstacle is seen, numbered, and hidden by no label."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely
from matplotlib.lines import Line2D

import ambinav as an
from ambinav.geometry.obstacle import Obstacle
from ambinav.plotting.canvas import root_figure
from ambinav.plotting.placement import MARKER, ROUND, PlacementView, label_spots, plot_placement
from ambinav.studies.design.improved import zones_after
from tests.drive.cases import laser

CORNERS = np.array([[0.0, 0.0], [400.0, 300.0]])
NO_LINES = np.empty((0, 2))


@pytest.fixture(scope="module")
def hall() -> an.AmbiguityMap:
    env = an.environment_from_shapes([shapely.box(0, 0, 60, 25)], name="hall")
    return an.build_map(env, laser(max_range=3.0, beams=24), 0.5, store=False)


def test_labels_hide_no_obstacle_and_no_label() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        at = rng.uniform((5.0, 5.0), (395.0, 295.0), (8, 2))
        spots = label_spots(at, CORNERS, NO_LINES)
        for spot, other in itertools.product(spots, at):
            assert np.hypot(*(spot - other)) >= ROUND + MARKER / 2
        for spot, other in itertools.combinations(spots, 2):
            assert np.hypot(*(spot - other)) >= 2 * ROUND
        assert (spots >= ROUND).all()
        assert (spots <= CORNERS[1] - ROUND).all()


def test_labels_keep_off_lines_where_there_is_room() -> None:
    line = np.column_stack([np.arange(400.0), np.full(400, 160.0)])
    (spot,) = label_spots(np.array([[200.0, 150.0]]), CORNERS, line)
    assert abs(spot[1] - 160.0) > ROUND


@pytest.mark.parametrize("kind", ["post", "panel", "tag"])
@pytest.mark.parametrize("reflective", [False, True])
def test_an_obstacle_is_drawn_as_in_the_legend_and_never_too_small(
    hall: an.AmbiguityMap, kind: str, reflective: bool
) -> None:
    small = shapely.Point(20.0, 10.0).buffer(0.05), shapely.box(40.0, 10.0, 40.02, 10.2)
    outlines = [small[0]] if kind == "post" else [small[1]]
    shown = PlacementView(reflective, outlines, (kind,) * len(outlines), improved=[(30.0, 5.0)])
    zone = hall.floor("zone").values
    before, after = (
        plot_placement(hall, zone, hall.judged, shown, placed=placed) for placed in (False, True)
    )
    legend = after.get_legend()
    assert legend is not None
    (entry,) = (line for line in legend.get_lines() if "put up" in str(line.get_label()))
    (drawn,) = (line for line in after.lines if line.get_zorder() == 6)
    assert isinstance(drawn, Line2D)
    assert drawn.get_color() == entry.get_color()
    if kind == "post":
        assert drawn.get_markersize() == entry.get_markersize() == MARKER
    else:
        ends = after.transData.transform(drawn.get_xydata()) * 72.0 / root_figure(after).dpi
        assert np.hypot(*(ends[1] - ends[0])) >= MARKER - 1e-6
        assert drawn.get_linewidth() == entry.get_linewidth()
    assert [text.get_text() for text in after.texts].count("1") == 1
    assert "1" not in [text.get_text() for text in before.texts]
    # One lies exactly on the other.
    assert before.get_position().bounds == after.get_position().bounds
    sizes = [root_figure(axes).get_size_inches() for axes in (before, after)]
    assert np.array_equal(*sizes)
    for axes in (before, after):
        assert [text.get_text() for text in axes.texts].count("A") == 1


def test_without_obstacles_the_picture_says_so_by_showing_none(hall: an.AmbiguityMap) -> None:
    zone, shown = hall.floor("zone").values, PlacementView(False, (), ())
    axes = plot_placement(hall, zone, hall.judged, shown, placed=True)
    legend = axes.get_legend()
    assert legend is not None
    assert not any("put up" in text.get_text() for text in legend.get_texts())


def test_the_pictures_fit_however_the_map_changes(hall: an.AmbiguityMap) -> None:
    """Where obstacles bring the first reflectors, and take away floor that ends the lattice."""
    block = Obstacle(shapely.box(0.0, 0.0, 60.0, 2.0), reflective=True)
    changed = hall.update(hall.environment.edited(add=[block]))
    assert changed.dataset.sizes["y"] < hall.dataset.sizes["y"]
    shown = PlacementView(True, [block.outline], ("panel",))
    before, after = (
        plot_placement(hall, zones_after(hall, then), hall.judged, shown, placed=then is changed)
        for then in (hall, changed)
    )
    assert before.get_position().bounds == after.get_position().bounds
    assert before.viewLim.bounds == after.viewLim.bounds
    legends = [axes.get_legend() for axes in (before, after)]
    texts = [[text.get_text() for text in legend.get_texts()] for legend in legends if legend]
    assert texts[0] == texts[1] and len(texts) == 2
