"""A pose whose sensor would stand inside a wall has no value: in no layer, and no cost."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.geometry.extrude import extruded
from ambinav.geometry.motion.steering import Steering
from ambinav.layers.aliasing.layer import aliased_poses
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE, ZONES
from ambinav.routes.evaluate import zone_codes
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from ambinav.service.service import AmbiguityService
from ambinav.studies.audit.ambiguous_regions import find_ambiguous_regions
from tests.geometry import scenes

TURN = 2 * math.pi
LASER = RangeSensor(max_range=3.0, std=0.02, resolution=0.001)
AHEAD = RangeScanner.planar(LASER, 12, 3.0, (0.31, 0.0, 0.0))
LAYERS = (
    "position", "fisher", "localizability", "coastal_entropy", "gfm", "wall_normals",
    "perturbation", "aliasing",
)  # fmt: skip


@pytest.fixture(scope="module")
def amap() -> AmbiguityMap:
    """A room of 2.4 x 1.6 m, at 8 headings, with every layer."""
    return build_map(scenes.room(2.4, 1.6), AHEAD, 0.2, headings=8, layers=LAYERS)


@pytest.fixture(scope="module")
def possible(amap: AmbiguityMap) -> np.ndarray:
    """Where the sensor is inside the room, shape (ny, nx, 8)."""
    data = amap.dataset
    x, y, theta = np.meshgrid(data["x"], data["y"], data["theta"])
    sx, sy = x + 0.31 * np.cos(theta), y + 0.31 * np.sin(theta)
    return (sx > 0) & (sx < 2.4) & (sy > 0) & (sy < 1.6) & data["free"].values[..., None]


def test_the_map_says_how_many_there_are(amap: AmbiguityMap, possible: np.ndarray) -> None:
    free = amap.dataset["free"].values
    count = int((~possible[free]).sum())
    assert amap.impossible_poses == count > 0
    assert f"{count} poses impossible" in repr(amap)
    assert np.isnan(amap.dataset["level"].values[free]).sum() == count


def test_every_layer_has_values_where_it_is_possible(
    amap: AmbiguityMap, possible: np.ndarray
) -> None:
    free = amap.dataset["free"].values
    assert possible[free].any(axis=1).all()
    assert 0.5 < possible[free].mean() < 0.95
    np.testing.assert_array_equal(amap.possible, possible)
    for name in amap.layers:
        values = amap.dataset[name]
        if "theta" not in values.dims:
            continue
        if name == "zone":
            np.testing.assert_array_equal(values.values != NOT_FREE, possible)
        elif name.startswith("aliasing_"):
            assert np.isnan(values.values[~possible]).all()
        else:
            np.testing.assert_array_equal(np.isfinite(values.values), possible, err_msg=name)
    for name in ("level_mean", "level_best", "level_worst", "fisher_mean", "gfm_best", "position"):
        np.testing.assert_array_equal(np.isfinite(amap.dataset[name].values), free, err_msg=name)


@pytest.mark.slow
def test_aggregates_are_of_the_possible_headings(amap: AmbiguityMap, possible: np.ndarray) -> None:
    level, free = amap.dataset["level"].values, amap.dataset["free"].values
    for row, column in np.argwhere(free):
        values = level[row, column][possible[row, column]]
        cell = amap.dataset.isel(y=row, x=column)

        def at(name: str, cell: xr.Dataset = cell) -> float:
            return float(cell[name])

        assert at("level_mean") == pytest.approx(values.mean(), rel=1e-5)
        assert at("level_best") == values.min()
        assert at("level_worst") == values.max()
        best = amap.dataset["theta"].values[np.nanargmin(level[row, column])]
        assert at("best_heading") == pytest.approx(best)
        assert at("zone_best") != NOT_FREE
        assert at("zone_worst") != NOT_FREE
    assert sum(share.share for share in amap.zone_shares("worst")) == pytest.approx(1.0)
    for heading in ("mean", "best", "worst"):
        assert np.isfinite(amap.floor("major_radius", heading).values[free]).all()
    for place in find_ambiguous_regions(amap, least_area=0.01):
        assert np.isfinite(place.by_heading).all()


def test_sample_and_cost(amap: AmbiguityMap, possible: np.ndarray) -> None:
    service = AmbiguityService(amap, "level")
    data = amap.dataset
    x, y, theta = np.meshgrid(data["x"], data["y"], data["theta"])
    sampled = np.asarray(amap.sample("level", x, y, theta))
    np.testing.assert_array_equal(np.isfinite(sampled), possible)
    np.testing.assert_allclose(sampled[possible], data["level"].values[possible], rtol=1e-6)
    np.testing.assert_array_equal(np.isfinite(amap.sample("zone", x, y, theta)), possible)
    cost = np.asarray(service.cost(x, y, theta))
    np.testing.assert_array_equal(np.isfinite(cost), possible)
    assert (cost[possible] >= 1.0).all()
    # At the wall ahead, and beside it; between two headings the nearer one decides.
    assert math.isinf(service.cost(2.3, 0.9, 0.0))
    assert math.isnan(amap.sample("level", 2.3, 0.9, 0.3))
    assert math.isfinite(service.cost(2.3, 0.9, math.pi))
    assert math.isnan(service.gradient(2.3, 0.9, 0.0)[0])
    # Motions are for a collision check to allow: their cost goes on.
    assert math.isfinite(service.motion_cost(1.0, 0.9, 2.35, 0.9, 0.0, 0.0))
    route = np.array([[1.0, 0.9, 0.0], [2.35, 0.9, 0.0]])
    assert math.isfinite(service.route_cost(route, Steering("se2")))
    assert (zone_codes(amap, route) < len(ZONES)).all()


def test_aliases_are_possible_poses(amap: AmbiguityMap) -> None:
    context = LayerContext.of(amap)
    found = aliased_poses(context, 3, least=1e-4).poses
    x, y = context.points
    for k, heading in enumerate(context.headings):
        assert np.isnan(found[~context.possible[:, k], k]).all()
        cell, rank = np.nonzero(np.isfinite(found[:, k, :, 3]))
        for ax, ay, turn, _ in found[cell, k, rank]:
            # The search moves a look-alike within its cell: the cell's own pose is possible.
            near = np.argmin(np.hypot(x - ax, y - ay))
            there = round((heading + turn) / (TURN / 8)) % 8
            around = np.hypot(x - ax, y - ay) < 0.3
            assert context.possible[near, there] or context.possible[around, there].any()


@pytest.mark.slow
def test_layers_do_not_read_what_is_impossible(
    amap: AmbiguityMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rubbish in the scans of impossible poses changes nothing."""
    import ambinav.layers.context as module

    names = ("coastal_entropy", "perturbation", "aliasing")
    plain = with_layers(amap, names)
    real = module.beam_returns

    def spoilt(env, scanner, table, x, y, theta, data):  # type: ignore[no-untyped-def]
        real(env, scanner, table, x, y, theta, data)
        bad = ~can_stand(env, scanner, x, y, theta)
        data[bad, 0], data[bad, 1:4], data[bad, 4] = 1.234, 0.5, 0.01

    monkeypatch.setattr(module, "beam_returns", spoilt)
    other = with_layers(amap, names)
    for name in names:
        np.testing.assert_array_equal(plain.dataset[name], other.dataset[name], err_msg=name)


@pytest.mark.parametrize(
    ("mount", "message"),
    [
        ((0.0, 0.0), "a sensor is 3 m above the floor, and the building ends at 2.5 m; mount it"),
        ((9.0, 0.0), "its body or a sensor stands inside a wall"),
    ],
)
def test_a_scanner_that_fits_nowhere(mount: tuple[float, float], message: str) -> None:
    room = scenes.room(2.4, 1.6)
    height = 3.0 if mount[0] == 0.0 else 1.0
    scanner = RangeScanner.planar(LASER, 12, 3.0, (*mount, 0.0)).raised(height)
    with pytest.raises(InputError, match=f"scanner .* fits: {message}"):
        build_map(room.in_space(extruded(room, 2.5)), scanner, 0.2, headings=8)


def test_a_ring_of_sonars_keeps_its_radius_from_walls() -> None:
    """Sensors around the robot: within their radius of a wall there is no pose, at any heading."""
    ring = RangeScanner.ring(LASER, 24, 0.25)
    amap = build_map(scenes.room(3.0, 2.0), ring, 0.1)
    assert not amap.has_theta
    free = amap.dataset["free"].values
    assert amap.dataset["clearance"].values[free].min() > 0.24
    assert np.isnan(amap.sample("level", 0.15, 1.0))
    assert np.isfinite(amap.sample("level", 0.35, 1.0))
    assert (amap.dataset["zone"].values[~free] == NOT_FREE).all()
