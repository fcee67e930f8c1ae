"""Pictures: what is drawn where, read back from the artists and from the pixels."""

from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
import shapely
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.occupancy_grid import OccupancyGrid
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import ZONES
from ambinav.plotting.canvas import save_figure
from ambinav.plotting.maps import plot_layer, plot_zones
from ambinav.plotting.solid_cells import padded_solid
from ambinav.plotting.style import UNKNOWN, ZONE_COLOURS, round_length
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.maps import synthetic


@pytest.fixture(scope="module")
def amap() -> AmbiguityMap:
    return AmbiguityMap(synthetic.dataset())


def colour_at(axes, x: float, y: float) -> tuple[int, int, int]:
    """Colour of the picture at a point of the map, 0 to 255."""
    axes.figure.canvas.draw()
    pixels = np.asarray(axes.figure.canvas.buffer_rgba())
    column, row = axes.transData.transform((x, y))
    return tuple(pixels[pixels.shape[0] - 1 - int(row), int(column), :3].tolist())


def byte(colour: str) -> tuple[int, int, int]:
    return tuple(round(255 * part) for part in to_rgb(colour))


def strokes(axes) -> np.ndarray:
    """Middle and direction of the strokes, (n, 4)."""
    lines = max(
        (c for c in axes.collections if isinstance(c, LineCollection)), key=lambda c: c.zorder
    )
    ends = np.array(lines.get_segments())
    return np.hstack([ends.mean(axis=1), ends[:, 1] - ends[:, 0]])


@pytest.mark.slow
def test_zones_have_their_colours_where_they_lie(amap):
    axes = plot_zones(amap, strokes=False)
    places = {"localizable": (2, 2), "transition": (4.2, 2), "corridor": (10, 2), "open": (21, 5)}
    for zone, (x, y) in places.items():
        assert colour_at(axes, x, y) == byte(ZONE_COLOURS[ZONES.index(zone)]), zone
    assert colour_at(axes, 10.0, 7.0) == byte(UNKNOWN)


def test_strokes_run_along_the_weak_direction(amap):
    found = strokes(plot_zones(amap))
    in_corridor = found[(found[:, 0] > 5) & (found[:, 0] < 15)]
    assert len(in_corridor) > 20
    assert np.abs(in_corridor[:, 3]).max() < 1e-6
    left_of_hall = found[(found[:, 0] > 16) & (found[:, 0] < 18) & (abs(found[:, 1] - 5) < 2)]
    assert np.abs(left_of_hall[:, 2]).max() < 1e-6
    # None where all directions are alike, and never crowded.
    for inside in ((0, 4, 0, 4), (18.1, 23.9, 2.1, 7.9)):
        a, b, c, d = inside
        x, y = found[:, 0], found[:, 1]
        assert not ((x > a) & (x < b) & (y > c) & (y < d)).any()
    gaps = np.hypot(*(found[:, None, :2] - found[None, :, :2]).transpose(2, 0, 1))
    assert gaps[~np.eye(len(found), dtype=bool)].min() > 0.5


def test_a_narrow_corridor_gets_strokes_too():
    # 2 m wide in a building 300 m long: the patch of a stroke is wider than the corridor.
    dataset = synthetic.for_a_point(synthetic.dataset()).dataset.isel(x=slice(50, 150))
    x = np.linspace(0.0, 300.0, dataset.sizes["x"])
    found = strokes(plot_zones(AmbiguityMap(dataset.assign_coords(x=x))))
    assert len(found) > 30


def test_legend_tells_shares_and_title_names_both(amap):
    axes = plot_zones(amap)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    # Of the 125 m² that are at least 0.2 m from all walls.
    assert labels[3] == "open\n29 %, 36 m²"
    assert axes.get_title(loc="left") == "Zones: made-up scanner in synthetic"


@pytest.mark.slow
def test_axes_tell_coordinates_in_metres(amap):
    axes = plot_zones(amap)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x (m)", "y (m)")
    axes.figure.canvas.draw()
    for ticks, limits in (
        (axes.get_xticks(), axes.get_xlim()),
        (axes.get_yticks(), axes.get_ylim()),
    ):
        inside = ticks[(ticks >= limits[0]) & (ticks <= limits[1])]
        assert len(inside) >= 3
        assert set(np.diff(inside).tolist()) == {2.0}


@pytest.mark.parametrize(
    ("width", "length"), [(27.0, 5.0), (4.0, 1.0), (3.9, 0.5), (1000.0, 200.0), (0.3, 0.05)]
)
def test_scale_bars_are_round(width, length):
    assert round_length(width) == pytest.approx(length)


@pytest.mark.slow
def test_layer_runs_from_zero_to_one_and_dark_is_ambiguous(amap):
    axes = plot_layer(amap, "level")
    assert axes.images[-1].get_clim() == (0.0, 1.0)
    assert sum(colour_at(axes, 21, 5)) < sum(colour_at(axes, 10, 2)) < sum(colour_at(axes, 2, 2))


@pytest.mark.slow
def test_radii_and_angles_have_scales_of_their_own():
    turning = AmbiguityMap(synthetic.dataset(headings=4))
    assert plot_layer(turning, "major_radius").images[-1].get_clim()[1] < 0.3
    assert plot_layer(turning, "direction").images[-1].get_clim() == (0.0, 180.0)
    assert plot_layer(turning, "level", heading=0.5).get_title(loc="left").endswith("29°)")
    with pytest.raises(InputError, match="plot_zones"):
        plot_layer(turning, "zone")


def test_draws_into_given_axes(amap):
    figure = Figure()
    first, second = figure.subplots(1, 2)
    assert plot_zones(amap, first) is first
    assert plot_layer(amap, "level", second, strokes=True) is second


@pytest.mark.slow
@pytest.mark.parametrize("part", [slice(None), slice(165, 200)])
def test_saved_picture_has_no_wide_margins(amap, tmp_path, part):
    tall = AmbiguityMap(amap.dataset.isel(x=part))
    save_figure(plot_zones(tall), tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as picture:
        pixels = np.asarray(picture.convert("L"))
    assert max(pixels.shape) > 1000
    used = pixels < 250
    rows, columns = np.nonzero(used.any(axis=1))[0], np.nonzero(used.any(axis=0))[0]
    assert rows[0] < 40
    assert columns[0] < 40
    assert pixels.shape[0] - rows[-1] < 40
    assert pixels.shape[1] - columns[-1] < 40


@pytest.mark.slow
def test_no_global_drawing_state():
    code = (
        "import sys, ambinav.plotting.maps, ambinav.plotting.scan; "
        "print('pyplot' in str(sys.modules))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ran.stdout.strip() == "False"


def test_an_obstacle_at_the_edge_of_a_plan_ends_there() -> None:
    room, crate = shapely.box(0, 0, 6, 4), shapely.box(2, 0, 2.8, 1.5)
    drawn = environment_from_shapes([room], [crate])
    state = np.zeros((40, 60), dtype=np.uint8)
    state[:15, 20:40] = 1
    for env, goes_on in ((drawn, False), (environment_from_grid(OccupancyGrid(state, 0.1)), True)):
        scanner = RangeScanner.planar(
            RangeSensor(max_range=3.0, std=0.02, resolution=0.01), 12, math.tau
        )
        amap = build_map(env, scanner, spacing=0.1)
        rows, columns = (size + 10 for size in amap.solid.shape)
        solid = padded_solid(amap, 5, (0, rows), (0, columns))
        assert solid[5:20, 5:-5].any()
        assert solid[:5].any() == goes_on
        for low, left in ((0, 0), (3, 20), (12, 30), (rows - 9, columns - 9)):
            part = padded_solid(amap, 5, (low, low + 9), (left, left + 9))
            assert np.array_equal(part, solid[low : low + 9, left : left + 9])
