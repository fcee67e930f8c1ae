"""Layers in maps: attributes, summaries over heading, options, on disk, read by the service."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from ambinav.layers.build import _mean, with_layers
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.maps import schema
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.service.service import AmbiguityService
from tests.geometry import scenes
from tests.maps import synthetic


@pytest.fixture(scope="module")
def fan() -> RangeScanner:
    sensor = RangeSensor(max_range=2.5, std=0.03, resolution=0.001)
    return RangeScanner.planar(sensor, 20, math.pi / 2)


@pytest.fixture(scope="module")
def turning(fan: RangeScanner) -> AmbiguityMap:
    room = scenes.room(5.0, 2.0)
    return build_map(room, fan, 0.2, headings=6, layers=("fisher", "wall_normals"))


def test_angles_are_not_averaged_across_their_end() -> None:
    """Half a turn to the left and half a turn to the right are the same."""
    amap = AmbiguityMap(synthetic.dataset(4))
    values = np.where(np.isnan(amap.dataset["level"]), np.nan, math.pi - 1e-3)
    values[:, ::2] *= -1.0
    turned = AmbiguityMap(amap.dataset.assign(aliasing_turn=(("y", "x", "theta"), values)))
    x = float(amap.dataset["x"][40]) + 0.5 * amap.spacing
    sampled = turned.sample("aliasing_turn", x, 2.0, 0.0)
    assert abs(sampled) == pytest.approx(math.pi - 1e-3)
    assert schema.is_nearest("aliasing_x_mean") and not schema.is_nearest("aliasing")
    room = scenes.room(3.0, 2.0)
    context = LayerContext.of(build_map(room, "rplidar-a1", 0.5, headings=4), room)
    turns = np.resize([math.pi - 1e-3, -math.pi + 1e-3], (int(context.free.sum()), 4))
    mean = _mean(context, "aliasing_turn", context.spread(turns))
    np.testing.assert_allclose(np.abs(mean[context.free]), math.pi, atol=1e-5)


@pytest.mark.parametrize("given", [False, True])
def test_a_part_of_a_map_gets_no_layers_that_compare_cells(
    laser: RangeScanner, tmp_path: Path, given: bool
) -> None:
    room = scenes.room(4.0, 2.0)
    whole = build_map(room, laser, 0.2, store=False)
    whole.save(tmp_path / "map.zarr")
    part = AmbiguityMap.open(tmp_path / "map.zarr", bounds=(1.0, 0.5, 3.0, 1.5))
    environment = room if given else None
    for names in ("coastal_entropy", ["fisher", "aliasing"]):
        with pytest.raises(InputError, match=r"part of its building.*for (coastal|alias).*bounds"):
            with_layers(part, names, environment=environment)
    ours = with_layers(part, "fisher", environment=environment).dataset["fisher"]
    theirs = with_layers(whole, "fisher", environment=environment).dataset["fisher"]
    np.testing.assert_array_equal(ours, theirs.sel(x=ours["x"], y=ours["y"]))


@pytest.mark.slow
def test_with_the_map_or_after_it_is_the_same_on_any_number_of_threads(
    laser: RangeScanner, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    room = scenes.room(4.0, 2.0)
    names = ("fisher", "localizability", "wall_normals", "clearance")
    shares: list[float] = []
    monkeypatch.setattr("numba.get_num_threads", lambda: 2)
    at_once = build_map(room, laser, 0.2, layers=names, progress=shares.append)
    monkeypatch.setattr("numba.get_num_threads", lambda: 1)
    build_map(room, laser, 0.2).save(tmp_path / "plain.zarr")
    plain = AmbiguityMap.open(tmp_path / "plain.zarr")
    later = with_layers(plain, names)
    added = set(at_once.layers) - set(plain.layers)
    assert added == {
        "fisher", "fisher_minor", "fisher_direction", "localizability",
        "localizability_determinant",
        "localizability_direction", "wall_normals", "wall_normals_strong",
        "wall_normals_direction",
    }  # fmt: skip
    for name in (*added, "clearance"):
        np.testing.assert_array_equal(at_once.dataset[name], later.dataset[name])
    np.testing.assert_array_equal(plain.dataset["clearance"], later.dataset["clearance"])
    assert schema.added(later.dataset) == ("clearance", *names[:3])
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    later.save(tmp_path / "later.zarr")
    stored = AmbiguityMap.open(tmp_path / "later.zarr")
    for name in added:
        np.testing.assert_array_equal(stored.dataset[name], later.dataset[name])
        assert stored.dataset[name].attrs == later.dataset[name].attrs


def test_attributes_tell_what_it_is(turning: AmbiguityMap) -> None:
    attrs = turning.dataset["fisher"].attrs
    assert attrs["units"] == "m"
    assert attrs["worse"] == "high"
    assert attrs["source"].startswith("Censi 2007")
    assert "worse" not in turning.dataset["fisher_minor"].attrs


def test_summaries_over_heading(turning: AmbiguityMap) -> None:
    data = turning.dataset
    every = data["fisher"].values
    assert data["fisher"].dims == ("y", "x", "theta")
    np.testing.assert_allclose(data["fisher_mean"], every.mean(axis=2), rtol=1e-6)
    np.testing.assert_array_equal(data["fisher_best"], every.min(axis=2))
    np.testing.assert_array_equal(data["fisher_worst"], every.max(axis=2))
    free = data["free"].values
    which = every[free].argmin(axis=1)[:, None]
    np.testing.assert_array_equal(
        data["fisher_minor_best"].values[free],
        np.take_along_axis(data["fisher_minor"].values[free], which, axis=1)[:, 0],
    )
    double = np.exp(2j * data["fisher_direction"].values[free]).mean(axis=1)
    found = np.exp(2j * data["fisher_direction_mean"].values[free])
    np.testing.assert_allclose(found, double / np.abs(double), atol=1e-5)
    # The walls in range do not turn with the robot.
    assert data["wall_normals"].dims == ("y", "x")
    assert "wall_normals_mean" not in data


def test_the_map_reads_them_as_its_own(turning: AmbiguityMap) -> None:
    best = turning.floor("fisher", "best")
    np.testing.assert_array_equal(best, turning.dataset["fisher_best"])
    assert turning.sample("fisher", 2.5, 1.0) == pytest.approx(
        float(turning.dataset["fisher_mean"].interp(x=2.5, y=1.0)), rel=1e-4
    )
    assert 0.0 <= turning.sample("fisher_direction", 2.5, 1.0, 0.3) < math.pi
    assert schema.is_axis("fisher_direction_worst")
    assert not schema.is_axis("fisher")


def test_the_service_takes_them_for_costs(turning: AmbiguityMap) -> None:
    service = AmbiguityService(turning, layer="fisher", weight=10.0)
    expected = 1.0 + 10.0 * turning.sample("fisher", 2.5, 1.0, 0.3)
    assert service.cost(2.5, 1.0, 0.3) == pytest.approx(expected, rel=1e-5)


def test_a_companion_that_is_high_where_it_is_good_is_no_cost(laser: RangeScanner) -> None:
    amap = build_map(scenes.room(3.0, 2.0), laser, 0.5, layers="localizability")
    assert AmbiguityService(amap, layer="localizability").cost(1.5, 1.0) > 1.0
    with pytest.raises(InputError, match="'localizability_determinant' is high where a robot is"):
        AmbiguityService(amap, layer="localizability_determinant")


def test_options_of_a_layer(laser: RangeScanner) -> None:
    amap = build_map(scenes.room(12.0, 12.0), laser, 0.5)
    near = with_layers(amap, "fisher", fisher={"odometry_std": 0.07})
    # In the middle no wall is in range: what is known beforehand is all.
    assert near.sample("fisher", 6.0, 6.0) == pytest.approx(0.07)
    assert json.loads(near.dataset["fisher"].attrs["options"]) == {"odometry_std": 0.07}
    assert with_layers(near, "fisher").sample("fisher", 6.0, 6.0) == pytest.approx(0.25)
    with pytest.raises(InputError, match=r"no option 'odo'; it takes odometry_std, "):
        with_layers(amap, ["fisher"], fisher={"odo": 1.0})
    with pytest.raises(InputError, match="clearance: it has no option 'limit'; it takes none"):
        with_layers(amap, ["clearance"], clearance={"limit": 1.0})
    with pytest.raises(InputError, match="options of 'gfm': this layer is not asked for"):
        with_layers(amap, ["fisher"], gfm={})
    with pytest.raises(InputError, match="odometry_std is -1"):
        with_layers(amap, ["fisher"], fisher={"odometry_std": -1})


def test_nothing_asked_for_changes_nothing(turning: AmbiguityMap) -> None:
    assert with_layers(turning, ()) is turning


def test_bad_names_are_refused_before_the_map_is_built(
    laser: RangeScanner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*arguments: object) -> None:
        raise AssertionError("the map was built for nothing")

    monkeypatch.setattr("ambinav.map_building.build._compute", never)
    with pytest.raises(InputError, match="did you mean fisher"):
        build_map(scenes.room(1.0, 1.0), laser, layers=["fishr"])
