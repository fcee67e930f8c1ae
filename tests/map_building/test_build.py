"""build_map: the dataset's contract, headings, tiles, progress and what is refused."""

from __future__ import annotations

import itertools
import json
import math
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ambinav
from ambinav.ambiguity import kernel
from ambinav.ambiguity.tensor import classify_over_headings
from ambinav.geometry.environment import Environment
from ambinav.map_building import build
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes

LAYERS = ("ambiguity", "major", "minor", "level", "major_radius", "minor_radius", "direction")
UNITS = {"major_radius": "m", "minor_radius": "m", "direction": "rad", "heading_radius": "rad",
         "clearance": "m", "best_heading": "rad", "level": "1", "heading": "1", "x": "m", "y": "m",
         "theta": "rad", "segments": "m"}  # fmt: skip


@pytest.fixture(scope="module")
def env() -> Environment:
    return scenes.scene(7, size=9.0, blocks=10, thin=4)


@pytest.fixture(scope="module")
def fan() -> RangeScanner:
    """Sees 120 degrees ahead."""
    sensor = RangeSensor(max_range=3.0, std=0.02, resolution=0.01)
    return RangeScanner.planar(sensor, 21, math.radians(120), name="fan")


@pytest.fixture(scope="module")
def flat(env: Environment, laser: RangeScanner) -> AmbiguityMap:
    return build_map(env, laser, spacing=0.2)


@pytest.fixture(scope="module")
def turning(env: Environment, fan: RangeScanner) -> AmbiguityMap:
    return build_map(env, fan, spacing=0.2, headings=4)


def same(one: AmbiguityMap, other: AmbiguityMap) -> bool:
    return one.dataset.drop_attrs().identical(other.dataset.drop_attrs())


@pytest.mark.parametrize("number", [np.float32, np.int64, np.float64])
def test_numbers_of_numpy_are_numbers(env: Environment, laser: RangeScanner, number: Any) -> None:
    amap = build_map(env, laser, number(1), number(2), store=False)
    assert same(amap, build_map(env, laser, 1.0, 2.0, store=False))


def test_few_beams_look_elsewhere_at_every_heading(env: Environment, laser: RangeScanner) -> None:
    assert not build_map(env, laser, 0.5, max_beams=24, store=False).has_theta
    few = build_map(env, laser, 0.5, max_beams=4, store=False)
    assert same(few, build_map(env, laser, 0.5, max_beams=4, headings=8, store=False))


@pytest.mark.slow
def test_a_scanner_goes_by_its_name_or_its_file(env: Environment, tmp_path: Path) -> None:
    by_name = build_map(env, "hokuyo-urg-04lx", spacing=0.5)
    scanner = RangeScanner.from_preset("hokuyo-urg-04lx")
    scanner.to_yaml(tmp_path / "own.yaml")
    assert same(by_name, build_map(env, scanner, spacing=0.5))
    assert same(by_name, build_map(env, tmp_path / "own.yaml", spacing=0.5))
    with pytest.raises(InputError, match="hokuyo-urg-04lx"):
        build_map(env, "hokuyo-urg-04", spacing=0.5)


# -- contract ----------------------------------------------------------------------------------


def test_dims_and_types_without_heading(flat: AmbiguityMap) -> None:
    dataset = flat.dataset
    assert "theta" not in dataset.coords and not flat.has_theta
    for name in (*LAYERS, "heading", "heading_radius", "clearance"):
        assert dataset[name].dims == ("y", "x") and dataset[name].dtype == np.float32, name
    assert dataset["zone"].dtype == np.uint8 and dataset["free"].dtype == np.bool_
    for name in ("x", "y", "segments"):
        assert dataset[name].dtype == np.float64
    assert dataset["segments"].dims == ("segment", "end")
    assert dataset["segment_kind"].dims == ("segment",)
    assert dataset["segment_kind"].dtype == np.uint8


def test_dims_and_types_with_headings(turning: AmbiguityMap) -> None:
    dataset = turning.dataset
    assert dataset["theta"].values == pytest.approx(np.arange(4) * math.pi / 2)
    for name in LAYERS:
        assert dataset[name].dims == ("y", "x", "theta") and dataset[name].dtype == np.float32
        assert dataset[f"{name}_mean"].dims == ("y", "x")
    assert dataset["zone"].dims == ("y", "x", "theta") and dataset["zone"].dtype == np.uint8
    for summary in ("mean", "best", "worst"):
        assert dataset[f"zone_{summary}"].dtype == np.uint8
    assert "heading" not in dataset
    assert dataset["free"].dims == dataset["clearance"].dims == ("y", "x")


def test_values_stand_where_it_is_free_and_nowhere_else(
    flat: AmbiguityMap, turning: AmbiguityMap, env: Environment
) -> None:
    for amap in (flat, turning):
        x, y = np.meshgrid(amap.dataset["x"], amap.dataset["y"])
        free = amap.dataset["free"].values
        assert (free == env.is_free(x, y)).all()
        for name in LAYERS:
            values = amap.dataset[name].values
            assert np.isfinite(values[free]).all() and np.isnan(values[~free]).all(), name
        zone = amap.dataset["zone"].values
        assert (zone[free] <= 3).all() and (zone[~free] == NOT_FREE).all()
        clearance = np.asarray(env.clearance(x, y))[free]
        assert amap.dataset["clearance"].values[free] == pytest.approx(clearance, rel=1e-6)


def test_units_and_names(flat: AmbiguityMap, turning: AmbiguityMap) -> None:
    for amap in (flat, turning):
        for name, variable in amap.dataset.variables.items():
            assert variable.attrs["long_name"] and variable.attrs["units"], name
            if name in UNITS:
                assert variable.attrs["units"] == UNITS[str(name)], name
    assert turning.dataset["level_mean"].attrs["units"] == "1"
    assert "mean" in turning.dataset["level_mean"].attrs["long_name"]


def test_where_it_comes_from(flat: AmbiguityMap, env: Environment, laser: RangeScanner) -> None:
    attrs = flat.dataset.attrs
    assert attrs["frame"] == "map" and attrs["units"] == "metres, radians"
    assert attrs["environment"] == env.name and attrs["scanner"] == laser.name
    assert RangeScanner.from_yaml_text(attrs["scanner_yaml"]).beams == 60
    parameters = json.loads(attrs["parameters"])
    assert parameters["spacing"] == 0.2 and parameters["radius"] == 0.5
    assert parameters["map_std"] == env.map_std and parameters["headings"] is None
    assert parameters["beams_used"] == 60 and parameters["tau"] >= 1
    assert parameters["free_poses"] == int(flat.dataset["free"].sum())
    assert {"numpy", "numba", "python"} <= set(json.loads(attrs["versions"]))
    assert json.loads(attrs["environment_notes"]) == []
    assert attrs["ambinav_version"] == ambinav.__version__
    assert datetime.fromisoformat(attrs["created"]).tzinfo is not None
    assert all(isinstance(value, str | int | float) for value in attrs.values())


@pytest.mark.slow
def test_the_checksum_of_the_file_is_kept(demo: Environment, laser: RangeScanner) -> None:
    amap = build_map(demo, laser, spacing=0.5)
    assert amap.dataset.attrs["environment_sha256"] == demo.checksum != ""
    assert amap.dataset.attrs["environment_source"].endswith("demo.geojson")


def test_walls_travel_with_the_map(flat: AmbiguityMap, env: Environment) -> None:
    assert (flat.segments.xy == env.segments.xy).all()
    assert (flat.segments.kind == env.segments.kind).all()


def test_public_names() -> None:
    assert ambinav.build_map is build_map


# -- headings ----------------------------------------------------------------------------------


def test_aggregates_are_those_of_the_layer(turning: AmbiguityMap) -> None:
    dataset = turning.dataset
    free = dataset["free"].values
    level = dataset["level"].values[free]
    for name in ("ambiguity", "major", "minor", "level", "major_radius", "minor_radius"):
        mean = dataset[name].values[free].mean(axis=1)
        assert dataset[f"{name}_mean"].values[free] == pytest.approx(mean, abs=1e-6)
    assert (dataset["level_best"].values[free] == level.min(axis=1)).all()
    assert (dataset["level_worst"].values[free] == level.max(axis=1)).all()
    best = np.take_along_axis(level, level.argmin(axis=1)[:, None], axis=1)[:, 0]
    at = np.round(dataset["best_heading"].values[free] / (math.pi / 2)).astype(int)
    assert (level[np.arange(len(at)), at] == best).all()
    zone = dataset["zone"].values[free]
    assert (dataset["zone_best"].values[free] == zone[np.arange(len(at)), at]).all()
    assert (dataset["zone_mean"].values[free] == classify_over_headings(zone)).all()
    assert (dataset["zone_mean"].values[~free] == NOT_FREE).all()


def test_each_heading_is_the_map_of_the_turned_scanner(env: Environment, fan: RangeScanner) -> None:
    env = env.transformed(0.1234)  # no beam exactly through a corner
    whole = build_map(env, fan, spacing=0.3, headings=4, tau=3.0)
    mount = (0.0, 0.0, math.pi / 2)
    turned = RangeScanner.planar(fan.sensors[0], 21, math.radians(120), mount)
    one = build_map(env, turned, spacing=0.3, headings=1, tau=3.0)
    a, b = whole.dataset["level"].values[..., 1], one.dataset["level"].values[..., 0]
    assert np.nanmax(np.abs(a - b)) < 1e-4


def test_how_many_headings_by_default(
    env: Environment, fan: RangeScanner, laser: RangeScanner
) -> None:
    assert build_map(env, fan, spacing=0.5).dataset.sizes["theta"] == build.HEADINGS
    assert "theta" not in build_map(env, laser, spacing=0.5).dataset.sizes
    assert build_map(env, laser, spacing=0.5, headings=2).dataset.sizes["theta"] == 2


# -- the same again ----------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [1, 2])
def test_twice_the_same_on_any_number_of_threads(
    env: Environment, laser: RangeScanner, flat: AmbiguityMap, monkeypatch: pytest.MonkeyPatch,
    threads: int,
) -> None:  # fmt: skip
    monkeypatch.setattr("numba.get_num_threads", lambda: threads)
    assert same(build_map(env, laser, spacing=0.2), flat)


@pytest.mark.parametrize(
    "poses",
    [pytest.param(1, marks=pytest.mark.slow), 60, pytest.param(400, marks=pytest.mark.slow)],
)
def test_tiles_change_nothing(
    env: Environment, laser: RangeScanner, fan: RangeScanner, flat: AmbiguityMap,
    turning: AmbiguityMap, monkeypatch: pytest.MonkeyPatch, poses: int,
) -> None:  # fmt: skip
    monkeypatch.setattr(build, "TILE_BYTES", 1)
    monkeypatch.setattr(build, "TILE_POSES", poses)
    calls: list[float] = []
    assert same(build_map(env, laser, spacing=0.2, progress=calls.append), flat)
    assert len(calls) > 3, "more than one tile"
    assert same(build_map(env, fan, spacing=0.2, headings=4), turning)


def test_more_beams_than_needed_are_thinned(env: Environment, laser: RangeScanner) -> None:
    dense = RangeScanner.planar(laser.sensors[0], 360, 2 * math.pi)
    thin = build_map(env, dense, spacing=0.3)
    assert json.loads(thin.dataset.attrs["parameters"])["beams_used"] == 60
    assert same(thin, build_map(env, laser, spacing=0.3))
    few = build_map(env, dense, spacing=0.3, max_beams=24)
    assert json.loads(few.dataset.attrs["parameters"])["beams_used"] == 24


# -- progress ----------------------------------------------------------------------------------


def test_progress_runs_from_nothing_to_all(
    env: Environment, fan: RangeScanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "TILE_BYTES", 1)
    monkeypatch.setattr(build, "TILE_POSES", 100)
    shares: list[float] = []
    build_map(env, fan, spacing=0.3, headings=3, progress=shares.append)
    assert len(shares) > 6
    assert all(a <= b for a, b in itertools.pairwise(shares))
    assert 0 < shares[0] < 1 and shares[-1] == 1.0


def test_an_interruption_comes_through(env: Environment, laser: RangeScanner) -> None:
    class Interruption(Exception):  # noqa: N818
        pass

    def stop(share: float) -> None:
        raise Interruption

    with pytest.raises(Interruption):
        build_map(env, laser, spacing=0.3, progress=stop)


def test_a_bar_on_standard_error(
    env: Environment, laser: RangeScanner, capsys: pytest.CaptureFixture[str]
) -> None:
    build_map(env, laser, spacing=0.5, progress=True)
    assert capsys.readouterr().out == ""


def test_pieces_between_interruptions_change_nothing(
    env: Environment, laser: RangeScanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = build_map(env, laser, spacing=0.3).dataset
    monkeypatch.setattr(kernel, "INTERRUPT_EVERY", 100_000)
    pieces = build_map(env, laser, spacing=0.3).dataset
    for name in LAYERS:
        assert np.array_equal(pieces[name].values, whole[name].values, equal_nan=True)


# -- what is refused ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("spacing", 0.0), ("spacing", -1.0), ("spacing", math.nan), ("spacing", math.inf),
        ("radius", 0.0), ("radius", math.nan), ("radius", math.inf), ("radius", 0.29),
        ("headings", 0), ("headings", -3),
        ("map_std", -0.01), ("map_std", math.nan), ("map_std", math.inf),
        ("tau", 0.99), ("tau", math.nan),
        ("sigma_theta", 0.0), ("sigma_theta", math.nan),
        ("outlier_share", 0.0), ("outlier_share", 1.0), ("outlier_share", math.nan),
        ("max_beams", 0), ("max_beams", -1),
        ("env", "office.yaml"), ("env", None), ("scanner", None), ("spacing", "0.3"),
        ("low", 0.0), ("low", 0.7), ("high", 0.0), ("high", 1.0), ("high", math.nan),
    ],
)  # fmt: skip
def test_bad_arguments_are_named(
    env: Environment, laser: RangeScanner, field: str, value: object
) -> None:
    arguments: dict[str, Any] = {"env": env, "scanner": laser, "spacing": 0.3} | {field: value}
    with pytest.raises(InputError, match=rf"^{field} is ") as caught:
        build_map(**arguments)
    message = str(caught.value)
    assert "\n" not in message and ("give" in message or "needs" in message)
    assert str(value) in message or f"{value:g}" in message


def test_spacing_larger_than_the_building(env: Environment, laser: RangeScanner) -> None:
    with pytest.raises(InputError, match=r"^spacing is 50 m but the free space of scene is only"):
        build_map(env, laser, spacing=50.0, radius=60.0)


def test_a_single_free_pose(laser: RangeScanner) -> None:
    amap = build_map(scenes.room(0.4, 0.4), laser, spacing=0.4, radius=0.5)
    assert int(amap.dataset["free"].sum()) == 1
    assert 0.0 <= amap.sample("level", 0.2, 0.2) <= 1.0
