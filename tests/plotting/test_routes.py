"""Pictures of routes: what is drawn where, read back from the artists and from the pixels."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.lines import Line2D
from matplotlib.patheffects import Stroke
from matplotlib.text import Annotation

from ambinav.geometry.motion.steering import Steering
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting import style
from ambinav.plotting.canvas import save_figure
from ambinav.plotting.components import plot_components
from ambinav.plotting.routes import plot_routes
from ambinav.routes.evaluate import evaluate_route
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from tests.maps import synthetic


@pytest.fixture(scope="module")
def amap() -> AmbiguityMap:
    return AmbiguityMap(synthetic.dataset())


def route_through(amap, *places, steering=None, **options):
    poses = [(x, y, 0.0) for x, y in places]
    service = AmbiguityService(amap, weight=options.pop("weight", 5.0))
    return evaluate_route(service, poses, steering or Steering(), planner="by hand", **options)


@pytest.fixture(scope="module")
def routes(amap):
    return {
        "shortest": route_through(amap, (1, 2), (17, 2), (24, 8)),
        "careful": route_through(amap, (1, 2), (17, 1), (24, 8)),
    }


def cased(axes) -> list[Line2D]:
    return [line for line in axes.lines if line.get_path_effects()]


def texts(figure) -> list[str]:
    axes = figure.axes[0]
    legends = sorted(axes.findobj(Legend), key=lambda legend: legend is not axes.get_legend())
    return [text.get_text() for legend in legends for text in legend.get_texts()]


def pixels(figure) -> np.ndarray:
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())[..., :3].astype(int)


def colour_at(figure, x, y) -> tuple[int, ...]:
    picture = pixels(figure)
    column, row = figure.axes[0].transData.transform((x, y))
    return tuple(picture[picture.shape[0] - 1 - int(row), int(column)].tolist())


def byte(colour: str) -> tuple[int, ...]:
    return tuple(round(255 * part) for part in to_rgb(colour))


@pytest.mark.slow
def test_routes_run_through_their_poses_and_keep_apart(amap, routes):
    figure = plot_routes(amap, routes)
    first, second = cased(figure.axes[0])
    np.testing.assert_allclose(first.get_xydata(), [(1, 2), (17, 2), (24, 8)])
    assert first.get_linewidth() > second.get_linewidth() + 2.0
    assert first.get_zorder() < second.get_zorder()
    assert colour_at(figure, 10.0, 2.0) == byte(style.route_style("ambiguity").colour)
    assert any(isinstance(effect, Stroke) for effect in first.get_path_effects())


def test_legend_tells_length_cost_and_metres_in_each_bad_zone(amap, routes):
    legend = texts(plot_routes(amap, routes))
    assert legend[:4] == ["localizable", "transition", "corridor", "open"]
    assert legend[4].startswith("not reachable by a\nrobot of ") and legend[5] == "unknown"
    route = routes["shortest"]
    assert legend[6] == (
        f"shortest\n{route.length:.1f} m, cost {route.cost:.1f} (weight 5)\n"
        f"corridor {route.corridor_metres:.1f} ({route.longest_corridor:.1f}) m, "
        f"open {route.open_metres:.1f} ({route.longest_open:.1f}) m"
    )


@pytest.mark.slow
def test_dollar_signs_in_a_route_s_name_are_shown(amap, routes):
    figure = plot_routes(amap, {r"$\hall$": routes["shortest"]})
    figure.canvas.draw()
    assert any(text.startswith(r"\$\hall\$") for text in texts(figure))


@pytest.mark.slow
def test_a_kind_of_route_has_one_colour(amap, routes):
    shortest = route_through(amap, (1, 2), (17, 2.2), (24, 8), weight=0.0)
    for named in (
        {"a": routes["shortest"], "b": shortest},
        {"b": shortest, "a": routes["careful"]},
    ):
        lines = dict(zip(named, cased(plot_routes(amap, named).axes[0]), strict=True))
        assert lines["a"].get_color() == style.route_style("ambiguity").colour
        assert lines["b"].get_color() == style.route_style("shortest").colour
    axes = plot_routes(amap, named, kinds={"a": "policy", "b": "planner"}).axes[0]
    assert [line.get_color() for line in cased(axes)] == [
        style.route_style("shortest").colour, style.route_style("policy").colour
    ]  # fmt: skip


def test_start_and_goal_are_marked_once(amap, routes):
    axes = plot_routes(amap, routes).axes[0]
    marks = [(t.get_text(), t.xy) for t in axes.texts if t.get_text() in ("S", "G")]
    assert marks == [("S", (1.0, 2.0)), ("G", (24.0, 8.0))]


def test_the_same_way_is_one_line(amap):
    drawn = {f"weight {w}": route_through(amap, (1, 2), (9, 2), weight=w) for w in (1, 3)}
    drawn["other"] = route_through(amap, (1, 2), (9, 2.5))
    figure = plot_routes(amap, drawn)
    assert len(cased(figure.axes[0])) == 2
    assert texts(figure)[6].startswith("weight 1, weight 3\n8.0 m\n")


def test_unnamed_routes_are_named_after_their_planner(amap, routes):
    figure = plot_routes(amap, list(routes.values()))
    assert [text.split("\n")[0] for text in texts(figure)[6:]] == [
        "by hand, weight 5 (1)", "by hand, weight 5 (2)"
    ]  # fmt: skip
    with pytest.raises(InputError, match="routes is empty"):
        plot_routes(amap, [])


@pytest.mark.slow
def test_curves_are_drawn_as_curves(amap):
    car = route_through(amap, (18, 2), (18, 8), steering=Steering("dubins", 1.0))
    line = cased(plot_routes(amap, [car]).axes[0])[0].get_xydata()
    assert len(line) > 50
    assert np.hypot(*np.diff(line, axis=0).T).sum() == pytest.approx(car.length, rel=1e-3)


def test_ellipses_are_two_standard_deviations(amap):
    along = np.array([0.8, 0.6])
    covariance = np.zeros((3, 3, 3))
    covariance[:, :2, :2] = 0.09 * np.outer(along, along) + 0.01 * (
        np.eye(2) - np.outer(along, along)
    )
    unsure = route_through(amap, (1, 2), (9, 2), (15, 2), covariances=covariance)
    axes = plot_routes(amap, [unsure]).axes[0]
    casing, ellipses = (a for a in axes.collections if isinstance(a, EllipseCollection))
    assert casing.get_linewidth()[0] > ellipses.get_linewidth()[0]
    np.testing.assert_allclose(ellipses.get_widths(), 4 * 0.3)
    np.testing.assert_allclose(ellipses.get_heights(), 4 * 0.1)
    turn = np.radians(ellipses.get_angles()) - np.arctan2(0.6, 0.8)
    np.testing.assert_allclose(np.sin(turn), 0.0, atol=1e-9)
    assert sorted(ellipses.get_offsets()[:, 0].tolist()) == [1.0, 9.0, 15.0]
    plain = plot_routes(amap, [unsure], covariances=False).axes[0]
    assert not any(isinstance(a, EllipseCollection) for a in plain.collections)


@pytest.mark.slow
@pytest.mark.parametrize("part", [slice(None), slice(165, 200)], ids=["wide", "tall"])
@pytest.mark.parametrize("count", [1, 5])
def test_nothing_overlaps(amap, part, count):
    building = AmbiguityMap(amap.dataset.isel(x=part))
    drawn = {f"route {i}": route_through(amap, (17, 2), (18, 3 + i)) for i in range(count)}
    figure = plot_routes(building, drawn)
    figure.canvas.draw()
    axes = figure.axes[0]
    renderer = figure.canvas.get_renderer()
    scale = [t for t in axes.texts if isinstance(t, Annotation) and t.get_text().endswith("m")]
    boxes = [a.get_window_extent(renderer) for a in (*axes.findobj(Legend), *scale)]
    boxes.append(axes.get_window_extent(renderer))
    assert len(boxes) == 4
    for i, box in enumerate(boxes):
        assert box.padded(-2).count_overlaps([b for j, b in enumerate(boxes) if j != i]) == 0
    # The floor is not squeezed by what is written about it.
    assert axes.get_window_extent().height > 0.5 * figure.bbox.height


@pytest.mark.slow
def test_draws_into_given_axes_and_saves(amap, routes, tmp_path):
    figure = Figure()
    axes = figure.subplots()
    size = figure.get_size_inches().tolist()
    assert plot_routes(amap, routes, axes) is figure
    assert figure.get_size_inches().tolist() == size
    save_figure(plot_routes(amap, routes), tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.slow
def test_headings_are_named_where_they_matter(routes):
    turning = AmbiguityMap(synthetic.dataset(headings=4))
    figure = plot_routes(turning, routes, heading="worst")
    assert "worst heading" in figure.axes[0].get_title(loc="left")
    captions = [legend.get_title().get_text() for legend in figure.axes[0].findobj(Legend)]
    assert any("own headings" in caption for caption in captions)


@pytest.mark.slow
def test_components_have_their_colours(amap):
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    labels = np.full(x.shape, -1)
    labels[(x > 1) & (x < 3) & (y > 1) & (y < 3)] = 4
    labels[(x > 17) & (x < 20) & (y > 1) & (y < 9)] = 0
    labels[(x > 22) & (x < 25) & (y > 1) & (y < 9)] = 7
    # The start lies a little outside of the cells that it reaches.
    figure = plot_components(amap, labels, (0.9, 2.0, 0.3), (18.0, 5.0), 4, 0)
    assert colour_at(figure, 2.5, 2.5) == byte(style.FROM_START)
    assert colour_at(figure, 19.0, 3.0) == byte(style.FROM_GOAL)
    assert colour_at(figure, 24.0, 5.0) == byte(style.FLOOR)
    assert colour_at(figure, 10.0, 2.0) == byte(style.UNREACHABLE)
    assert texts(figure)[:2] == [
        "reachable from the start\n4.0 m²",
        "reachable from the goal\n24 m²",
    ]
    assert "No path" in figure.axes[0].get_title(loc="left")


def test_components_need_the_map_lattice(amap):
    with pytest.raises(InputError, match=r"shape \(2, 2\)"):
        plot_components(amap, np.zeros((2, 2), dtype=int), (1, 1), (2, 2), 0, 0)


def test_where_no_cell_fits_all_is_drawn_as_no_room(amap):
    nowhere = np.full(amap.dataset["free"].shape, -1)
    figure = plot_components(amap, nowhere, (1, 1), (2, 2), 3, 5)
    assert colour_at(figure, 2.5, 2.5) == byte(style.UNREACHABLE)
    assert texts(figure)[0].startswith("no room for the robot")


@pytest.mark.sweep
def test_no_global_drawing_state():
    code = (
        "import sys, ambinav.plotting.routes, ambinav.plotting.components; "
        "import ambinav.plotting.pareto; "
        "print('pyplot' in str(sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"
