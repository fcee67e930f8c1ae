"""The bound of a scan with ranges to beacons: closed forms, straight lines, simulated ranges."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares
from typer.testing import CliRunner

import ambinav as an
from ambinav import with_layers
from ambinav.cli import app
from ambinav.layers.beacons import range_information
from tests.geometry import scenes

LASER = an.RangeSensor(max_range=1.0, std=0.02, resolution=0.001)
AROUND = an.RangeScanner.planar(LASER, 16, 2 * math.pi)
DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"
CORNERS = ((0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0))
PLACES = st.tuples(st.floats(1.0, 7.0), st.floats(1.0, 5.0))


@pytest.fixture(scope="module")
def hall() -> an.Environment:
    return scenes.room(8.0, 6.0)


@pytest.fixture(scope="module")
def hall_map(hall: an.Environment) -> an.AmbiguityMap:
    return an.build_map(hall, AROUND, spacing=0.25, store=False)


def test_where_no_wall_is_in_range_only_the_ranges_count(hall_map: an.AmbiguityMap) -> None:
    amap = with_layers(
        hall_map, ["fisher", "beacons"], fisher={"odometry_std": 0.5},
        beacons={"at": CORNERS, "std": 0.2, "odometry_std": 0.5},
    )  # fmt: skip
    x, y = 3.125, 2.625
    towards = np.array(CORNERS) - (x, y)
    towards /= np.linalg.norm(towards, axis=1)[:, None]
    covariance = np.linalg.inv(np.eye(2) / 0.5**2 + towards.T @ towards / 0.2**2)
    minor, major = np.sqrt(np.linalg.eigvalsh(covariance))
    assert amap.sample("fisher", x, y) == pytest.approx(0.5)
    for name, wanted in (("", major), ("_minor", minor), ("_alone", major), ("_in_view", 4)):
        assert amap.sample(f"beacons{name}", x, y) == pytest.approx(wanted, rel=1e-5)


@pytest.mark.slow(kept=("0.05",))
@pytest.mark.parametrize("std", [0.05, 0.2])
def test_simulated_ranges_are_as_good_as_the_bound(hall: an.Environment, std: float) -> None:
    """Least squares with many draws, in three dimensions: it shares no code with the layer."""
    at = np.array([(0.5, 0.5, 2.5), (7.5, 1.0, 2.0), (4.0, 5.8, 3.0)])
    here, low = np.array([2.0, 2.0]), 0.4
    information, seen = range_information(hall, *here, at, std=std, receiver=low)
    assert seen.all()
    rng = np.random.default_rng(4)

    def ranges(place: np.ndarray) -> np.ndarray:
        return np.linalg.norm(at - (*place, low), axis=1)

    drawn = ranges(here) + rng.normal(0.0, std, (2000, 3))
    errors = [least_squares(lambda p, r=r: ranges(p) - r, here).x - here for r in drawn]
    measured = np.sqrt(np.linalg.eigvalsh(np.cov(np.transpose(errors))))
    bound = np.sqrt(np.linalg.eigvalsh(np.linalg.inv(information[0])))
    np.testing.assert_allclose(measured, bound, rtol=0.06)


@pytest.mark.slow
@given(PLACES, PLACES, st.floats(2.0, 9.0))
def test_in_view_is_a_straight_line(
    here: tuple[float, float], beacon: tuple[float, float], longest: float
) -> None:
    wall = shapely.box(3.9, 0.0, 4.1, 3.5)
    env = an.environment_from_shapes([shapely.box(0.0, 0.0, 8.0, 6.0).difference(wall)])
    line = shapely.LineString([here, beacon])
    if any(shapely.dwithin(wall, shapely.Point(end), 0.2) for end in (here, beacon)):
        return
    if abs(shapely.distance(wall, line)) < 1e-6 and not line.crosses(wall):
        return
    information, seen = range_information(env, *here, [beacon], max_range=longest)
    wanted = not line.intersects(wall) and line.length <= longest
    assert seen.tolist() == [[wanted]]
    assert information.any() == (wanted and line.length > 0.0)


def test_a_range_from_right_below_says_nothing(hall: an.Environment) -> None:
    information, seen = range_information(hall, [4.0], [3.0], [(4.0, 3.0, 2.5)])
    assert seen.all() and not information.any()


@pytest.mark.parametrize("x", [3.9, 3.96, 4.0, 4.04, 4.1])
def test_a_beacon_on_a_thin_wall_is_in_view_from_its_side_alone(x: float) -> None:
    wall = shapely.box(3.95, 0.0, 4.05, 6.0)
    env = an.environment_from_shapes([shapely.box(0.0, 0.0, 8.0, 6.0).difference(wall)])
    rng = np.random.default_rng(2)
    left = np.column_stack([rng.uniform(0.1, 3.8, 300), rng.uniform(0.1, 5.9, 300)])
    right = np.column_stack([8.0 - left[:, 0], left[:, 1]])
    for side, wanted in ((left, x < 4.0), (right, x > 4.0)):
        seen = range_information(env, *side.T, [(x, 3.0)])[1]
        assert seen.all() == wanted == seen.any() or x == 4.0


def test_a_beacon_deep_in_a_wall_or_outside_is_named(hall: an.Environment) -> None:
    for place in ((-0.2, 3.0), (20.0, 20.0)):
        with pytest.warns(an.InputWarning, match="within a wall or outside of .*move it to"):
            assert not range_information(hall, 4.0, 3.0, [place])[1].any()
    assert range_information(hall, 4.0, 3.0, [(-0.05, 3.0)])[1].all()


@pytest.mark.slow
def test_a_demo_beacon_is_in_view_as_by_straight_lines() -> None:
    """All cells of a building with slanted and round walls, against shapely."""
    env = an.load_environment(DEMO)
    x, y = (
        axis.ravel()
        for axis in np.meshgrid(np.arange(0.317, 44.0, 1.1), np.arange(0.329, 28.0, 0.9))
    )
    inside = env.is_free(x, y)
    x, y = x[inside], y[inside]
    at = [(10.2, 17.2), (29.8, 17.2), (38.0, 24.0)]
    seen = range_information(env, x, y, at, max_range=100.0)[1]
    for k, beacon in enumerate(at):
        lines = shapely.linestrings([[place, beacon] for place in zip(x, y, strict=True)])
        wanted = shapely.covers(env.free.buffer(1e-9), lines)
        assert (seen[:, k] == wanted).all()
        assert 20 < wanted.sum() < len(x)


def test_an_updated_map_has_the_layer_of_a_new_one(hall: an.Environment) -> None:
    """A wall that hides a beacon is farther away than any beam sees."""
    options: dict[str, Any] = {"beacons": {"at": np.array(CORNERS), "max_range": 12.0}}
    before = with_layers(an.build_map(hall, AROUND, 0.25, store=False), ["beacons"], **options)
    changed = hall.edited(add=[an.Obstacle(shapely.box(6.5, 1.0, 7.0, 2.0))])
    after = with_layers(an.build_map(changed, AROUND, 0.25, store=False), ["beacons"], **options)
    updated = before.update(changed)
    for name in ("beacons", "beacons_alone", "beacons_in_view"):
        was, now = (amap.dataset[name].values for amap in (updated, after))
        np.testing.assert_allclose(was, now, rtol=1e-6)
    fewer = after.dataset["beacons_in_view"].values < before.dataset["beacons_in_view"].values
    assert fewer.sum() > 20


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "beacons: there are none; give their places as `at`"),
        ({"at": [1.0, 2.0]}, "beacons: there are none"),
        ({"at": [(1.0, math.nan)]}, r"at\[0\] is \[1.0, nan\]"),
        ({"at": CORNERS, "std": 0.0}, "std is 0.0; give metres above 0"),
        ({"at": CORNERS, "max_range": -1.0}, "max_range is -1.0"),
        ({"at": CORNERS, "receiver": math.inf}, "receiver is inf"),
        ({"at": CORNERS, "tau": 0.5}, "tau is 0.5; give at least 1"),
    ],
)
def test_bad_input(hall_map: an.AmbiguityMap, options: dict[str, Any], message: str) -> None:
    with pytest.raises(an.InputError, match=message):
        with_layers(hall_map, ["beacons"], beacons=options)


@pytest.mark.slow
def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plan = {"type": "Polygon", "coordinates": [[*CORNERS, CORNERS[0]]]}
    Path("hall.geojson").write_text(json.dumps(plan))
    Path("at.geojson").write_text(json.dumps({"type": "MultiPoint", "coordinates": CORNERS}))
    Path("at.wkt").write_text("POINT Z (1 1 2)\nPOINT (2 2)\n")
    call = ["map", "hall.geojson", "-s", "turtlebot3-lds", "--spacing", "0.25", "-o", "m.zarr"]
    words = ["--beacons", "at.geojson", "--beacon-std", "0.2", "--beacon-range", "7"]
    result = CliRunner().invoke(app, [*call, *words, "--json"])
    assert result.exit_code == 0, result.output
    amap = an.AmbiguityMap.open("m.zarr")
    information, seen = range_information(
        amap.environment, 2.125, 2.125, CORNERS, std=0.2, max_range=7.0
    )
    assert amap.sample("beacons_in_view", 2.125, 2.125) == seen.sum() == 3
    alone = np.linalg.inv(information[0] + np.eye(2) / 0.25**2)  # half the neighbourhood's radius
    wanted = math.sqrt(np.linalg.eigvalsh(alone)[-1])
    assert amap.sample("beacons_alone", 2.125, 2.125) == pytest.approx(wanted, rel=1e-5)
    for words, message in (
        (["--beacon-std", "1"], "--beacon-std is for --beacons"),
        (["--beacons", "hall.geojson"], "hall.geojson: it is a Polygon; give points"),
        (["--beacons", "at.geojson", "--tile", "4"], "--beacons is not for --tile"),
        (["--beacons", "at.wkt", "--beacon-range", "0"], "--beacon-range: 0 is not above zero"),
        (["--beacons", "at.wkt", "--extrude", "2"], "cannot have beacons"),
    ):
        result = CliRunner().invoke(app, [*call[:-1], "n.zarr", *words])
        assert result.exit_code == 2 and message in result.stderr, result.stderr
        assert not Path("n.zarr").exists()
