"""Every outlet of a map counts the same floor: that of the layer `judged`."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

import ambinav as an
from ambinav.demo import DEMO_BUILDING
from ambinav.export.formats.covariance import covariance_grid
from ambinav.maps.judged_floor import JUDGED, TOO_CLOSE
from ambinav.runtime.errors import InputWarning
from tests import recorded
from tests.judged.buildings import LASER, on_a_page, seen_in_part
from tests.judged.outlets import (
    OUTLETS,
    ROUNDED,
    Made,
    codes_at,
    of_layer,
    places_of,
    shape_of,
    written,
)
from tests.judged.studies import STUDIES, of_map

pytestmark = pytest.mark.filterwarnings("ignore:.*it is empty", "ignore:.*rim")

FAN = an.RangeScanner.planar(
    an.RangeSensor(max_range=3.0, std=0.02, resolution=0.01), 19, math.pi, name="laser ahead"
)


def make(env: an.Environment, scanner: an.RangeScanner, folder: Path, spacing: float) -> Made:
    # Exports for Autoware want 1.2 m.
    amap = an.build_map(env, scanner, spacing=spacing, radius=max(1.2, 2 * spacing), store=False)
    return Made(amap, env, scanner, folder)


@pytest.fixture(
    scope="module",
    params=[
        "seen in part",
        "page",
        "page, ahead",
        pytest.param("seen in part, ahead", marks=pytest.mark.slow),
        pytest.param("demo", marks=pytest.mark.slow),
    ],
)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    folder = tmp_path_factory.mktemp("outlets")
    if request.param == "demo":
        return make(an.load_environment(DEMO_BUILDING), LASER, folder, 0.5)
    scanner = FAN if "ahead" in request.param else LASER
    if "seen in part" in request.param:
        return make(seen_in_part(), scanner, folder, 0.25)
    return make(on_a_page(), scanner, folder, 0.2)


def hold(made: Made) -> None:
    """Check all outlets, and that no worst place lies off the judged floor."""
    truth = of_layer(made.amap)
    free = made.amap.free_area
    for name, outlet in OUTLETS.items():
        # Shares are told to a hundredth of a percent.
        margin = ROUNDED.get(name, 0.0) + (1e-4 if name in ("gates", "audit") else 1e-6) * free
        for part, area in outlet(made).items():
            if name == "zones-lanelet2":  # outlines are smoothed by less than a cell
                margin = 0.1 * truth[part] + 4 * made.amap.cell_area
            assert area == pytest.approx(truth[part], abs=margin), (name, part)
    for who, x, y in places_of(made):
        assert codes_at(made.amap, np.array([x]), np.array([y]))[0] == JUDGED, (who, x, y)


@pytest.mark.slow
def test_outlets_agree(made: Made) -> None:
    hold(made)


def test_there_is_floor_of_every_kind(tmp_path: Path) -> None:
    part, page = (of_layer(make(env, LASER, tmp_path, 0.25).amap)
                  for env in (seen_in_part(), on_a_page()))  # fmt: skip
    assert part["unexplored"] > 1.0 and part["judged"] > 20.0
    # The closed room of 4 x 1.6 m, and the margin around the building, each less 0.2 m.
    assert page["not reachable"] == pytest.approx(3.6 * 1.2, rel=0.15)
    assert page["outside of the building"] == pytest.approx(25.6 * 15.6 - 18.4 * 8.4, rel=0.05)
    assert page["judged"] == pytest.approx(7.6 * 6.8 + 6.6 * 1.2, rel=0.1)
    assert page["too close to walls"] > 1.0 and page["unexplored"] == 0.0


def test_graded_masks_hold_the_layer_on_judged_floor_alone(made: Made) -> None:
    amap = made.amap
    counted = amap.dataset["judged"].values == JUDGED
    layer = np.asarray(amap.floor(amap.cost_layer).values, dtype=np.float64)
    for kind in ("nav2-preference", "nav2-speed"):
        pixels = np.asarray(Image.open(written(made, kind, f"{kind}.yaml")[1]))[::-1]
        assert not pixels[~counted].any(), kind
        # The same grey for the same level: nothing of the judged floor is left out.
        share = pixels[counted] / pixels.max()
        np.testing.assert_allclose(share, layer[counted] / layer[counted].max(), atol=0.02)


def test_errors_for_autoware_lie_on_judged_floor(made: Made) -> None:
    amap = made.amap
    file = written(made, "zones-autoware", "a.geojson", least_area=0.0)[0]
    shapes = [shape_of(one) for one in json.loads(file.read_text())["features"]]
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    marked = shapely.contains_xy(shapely.union_all(shapes), x, y)
    assert (amap.dataset["judged"].values[marked] == JUDGED).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_studies_count_the_same_floor(made: Made, name: str) -> None:
    truth = of_map(made.amap)
    for part, value in STUDIES[name](made).items():
        # Reports have hundredths of a square metre, and shares to a hundredth of a percent.
        margin = 1e-4 if part == "mean level" else 0.011 + 1e-4 * truth["judged"]
        assert value == pytest.approx(truth[part], abs=margin), part


def test_covariances_are_of_floor_where_an_estimate_can_lie(made: Made) -> None:
    """Judged floor, or too close to walls and explored: the file says so."""
    code, known = made.amap.dataset["judged"].values, np.isfinite(covariance_grid(made.amap)[0])
    assert known[code == JUDGED].all()
    assert np.isin(code[known], (JUDGED, TOO_CLOSE)).all()
    assert not (known & made.amap.unexplored).any()
    with np.load(written(made, "covariance-npz", "c.npz")[0]) as arrays:
        np.testing.assert_array_equal(np.isfinite(arrays["covariance"][..., 0, 0]), known)
        about = json.loads(str(arrays["about"]))
    assert about["floor"].startswith("judged, or explored but too close to walls")
    assert about["robot_radius"] == made.amap.judged.radius


def test_a_report_and_a_client_have_the_layer(made: Made) -> None:
    """What is saved and fetched is judged as what was built."""
    made.amap.save(made.folder / "map.zarr")
    again = an.AmbiguityMap.open(made.folder / "map.zarr")
    assert of_layer(again) == of_layer(made.amap)
    assert (again.judged.radius, again.judged.start) == (made.amap.judged.radius, None)
    older = an.AmbiguityMap(again.dataset.drop_vars("judged"))
    np.testing.assert_array_equal(older.judged.code, made.amap.judged.code)


def test_an_empty_export_says_so(tmp_path: Path) -> None:
    closet = an.environment_from_shapes([shapely.box(0.0, 0.0, 2.0, 1.5)], name="closet")
    good = make(closet, an.RangeScanner.from_preset("rplidar-a1"), tmp_path, 0.25)
    for kind, name in (
        ("nav2-keepout", "k.yaml"), ("nav2-binary", "b.yaml"), ("zones-geojson", "z.geojson"),
        ("zones-lanelet2", "z.osm"),
    ):  # fmt: skip
        with pytest.warns(InputWarning, match=rf"^{name[0]}\.\w+: it is empty, for no judged"):
            assert written(good, kind, name)[0].is_file()


@pytest.mark.sweep
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", range(4))
def test_outlets_agree_on_all_maps(data_dir: Path, tmp_path: Path, part: int) -> None:
    for file in recorded.all_maps(data_dir)[part::4]:
        env, _ = recorded.read(file)
        spacing = max(0.4, math.sqrt(env.free.area / 2_500))
        made = make(env, laser(spacing), tmp_path, spacing)
        try:
            hold(made)
        except AssertionError as error:
            raise AssertionError(f"{file.name}: {error}") from error


def laser(spacing: float) -> an.RangeScanner:
    """Sees about ten cells far, so that there are bad places."""
    sensor = an.RangeSensor(max_range=max(3.0, 8.0 * spacing), std=0.03, resolution=0.01)
    return an.RangeScanner.planar(sensor, 24, math.tau)
