"""Layers in space: of an extruded plan those of the plan, and what a third dimension changes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.casting.prisms.prisms import Prisms, Solid
from ambinav.casting.space import SpaceRays
from ambinav.geometry.environment import Environment
from ambinav.geometry.extrude import extruded
from ambinav.layers.voxels import levels, voxel_range, voxels
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes
from tests.geometry.furnished import furnished

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

SENSOR = RangeSensor(max_range=3.0, std=0.02, resolution=0.001)
# Turned by a hair: no beam looks along a wall.
LASER = RangeScanner.planar(SENSOR, 40, math.tau, (0.0, 0.0, 0.003)).raised(0.4)
AHEAD = RangeScanner.planar(SENSOR, 20, math.pi, (0.1, 0.05, 0.003)).raised(0.7)
RING = RangeScanner.from_preset("polaroid-6500-ring").raised(0.4)
LIDAR = RangeScanner.layered(SENSOR, 24, np.radians([-15.0, 0.0, 10.0]), z=0.5)


def tall(env: Environment) -> Environment:
    return env.in_space(extruded(env, 2.5))


def made(env: Environment, scanner: RangeScanner, layer: str, **options: Any) -> Any:
    arguments = {"spacing": 0.5, "radius": 0.6, **options}
    return build_map(env, scanner, layers=layer, store=False, **arguments).dataset


@pytest.mark.slow(
    kept=("perturbation-ahead", "gfm-around", "best_aperture-around", "localizability-ahead")
)
@pytest.mark.parametrize("scanner", [LASER, AHEAD], ids=["around", "ahead"])
@pytest.mark.parametrize("layer", ["perturbation", "gfm", "best_aperture", "localizability"])
def test_of_an_extruded_plan_it_is_that_of_the_plan(layer: str, scanner: RangeScanner) -> None:
    # Turned, so that poses of the lattice lie in line with no corner.
    plan = scenes.scene(8, size=8.0, blocks=4, thin=2).transformed(0.3, 0.013, 0.007)
    options = {"headings": 2} if scanner is AHEAD else {}
    flat, solid = (made(env, scanner, layer, **options) for env in (plan, tall(plan)))
    names = [name for name in flat.data_vars if str(name).startswith(layer)]
    assert names and set(names) <= set(solid.data_vars)
    for name in names:
        one, other = flat[name].values, solid[name].values
        assert np.isfinite(one).sum() > 50, name
        assert (np.isnan(one) == np.isnan(other)).all(), name
        apart = np.abs(one - other)[np.isfinite(one)]
        if flat[name].attrs["units"] == "rad":
            apart = np.minimum(apart, math.pi - apart)
        assert (apart > 1e-3 * max(1.0, float(np.nanmax(one)))).mean() <= 0.01, name


def aisle(height: float) -> Environment:
    """A corridor 24 m long, with racks of so many metres across it on one side, and the same bare.

    The plan is that of the corridor: the racks hang from 1 m up.
    """
    plan = scenes.room(24.0, 2.0)
    walls = np.array([[0, 0, 24, 0], [24, 0, 24, 2], [24, 2, 0, 2], [0, 2, 0, 0]], dtype=float)
    racks = [
        Solid(shapely.box(x, 1.6, x + 0.4, 2.0), 1.0, 1.0 + height)
        for x in np.arange(0.7, 23.0, 1.9)
    ]
    space = Prisms(walls, [(0.0, 2.5)] * 4, solids=racks, floor=0.0, ceiling=2.5)
    return plan.in_space(space)


def middle(dataset: Any, layer: str) -> float:
    """Its mean away from the ends of the corridor."""
    values = dataset[layer].sel(x=slice(8.0, 16.0)).values
    return float(np.nanmean(values))


@pytest.mark.parametrize("layer", ["perturbation", "gfm", "localizability"])
def test_what_hangs_at_the_scanners_height_is_seen(layer: str) -> None:
    below, level = (middle(made(aisle(0.8), LASER.raised(up), layer), layer) for up in (0.0, 1.0))
    assert level < 0.9 * below


@pytest.mark.parametrize("layer", ["perturbation", "localizability"])
def test_a_3d_scanner_knows_its_place_by_what_hangs_above_it(layer: str) -> None:
    upward = RangeScanner.layered(SENSOR, 24, np.radians([0.0, 25.0, 40.0]), z=0.5)
    with_racks = middle(made(aisle(0.8), upward, layer), layer)
    bare = middle(made(tall(scenes.room(24.0, 2.0)), upward, layer), layer)
    assert with_racks < 0.3 * bare and bare > 0.2


@pytest.mark.sweep
def test_expected_ranges_on_voxels_are_near_the_true_ones() -> None:
    """In a furnished room, along rays anywhere: what a ray grazes alone is blurred by more."""
    env, _ = furnished()
    assert isinstance(env.space, Prisms)
    rng = np.random.default_rng(5)
    rays = SpaceRays.layers(np.radians([-60.0, -20.0, 0.0, 15.0, 50.0]), np.arange(24) * 0.26, 0.9)
    x, y = rng.uniform((0.4, 0.4), (5.6, 3.6), (30, 2)).T
    theta = rng.uniform(-3.0, 3.0, 30)
    true, _, _ = env.space.cast_scans(x, y, theta, rays, 3.0, incidence=False)
    z = levels(env.space, 0.02, 0.02, 0.0, 2.5)
    grid = voxels(env, env.space, 0.02, 0.02, z)
    off = []
    for k, (origins, looks) in enumerate(zip(*rays.at(x, y, theta), strict=True)):
        for origin, look, distance in zip(origins, looks, true[k], strict=True):
            if np.isfinite(distance) and distance > 0.2:
                mean, variance, _ = voxel_range(*origin, *look, 3.0, grid)
                off.append(mean - distance)
                assert variance >= 0.0
    assert len(off) > 2000
    assert np.quantile(np.abs(off), 0.9) < 0.12 and abs(np.median(off)) < 0.05


@pytest.mark.parametrize(("layer", "scanner", "part"), [
    ("gfm", LIDAR, "gfm: it looks up and down, and hit points on floor"),
    ("wall_normals", LASER, "wall_normals: the building is in space, and the layer counts metres"),
    ("best_aperture", LIDAR, "only a single planar fan"),
    ("localizability", RING, "localizability: the building is in space, and the layer is known"),
])  # fmt: skip
def test_what_has_no_meaning_in_space_is_refused(
    layer: str, scanner: RangeScanner, part: str
) -> None:
    with pytest.raises(InputError, match=part):
        made(tall(scenes.room(4.0, 3.0)), scanner, layer)


def test_a_mesh_has_no_perturbation_and_its_gfm_is_that_of_prisms() -> None:
    prisms, mesh = furnished()
    for layer in ("perturbation", "localizability"):
        with pytest.raises(InputError, match="the building is a mesh, and"):
            made(mesh, LASER, layer)
    one, other = (made(env, LASER, "gfm")["gfm"].values for env in (prisms, mesh))
    assert np.nanmax(np.abs(one - other)) <= 1 / 64 + 1e-6


@pytest.mark.parametrize("layer", ["expected_error", "lost_rate"])
def test_forecasts_in_a_mesh_are_those_of_prisms(layer: str) -> None:
    prisms, mesh = furnished()
    one, other = (made(env, LASER, layer)[layer].values for env in (prisms, mesh))
    assert np.isfinite(one).sum() > 40
    near = np.isclose(one, other, rtol=0.05, atol=1e-3, equal_nan=True)
    # Rays that meet an edge of the table may be on either of its faces.
    assert near.mean() > 0.95


@pytest.mark.sweep
def test_sonars_in_space_have_a_perturbation() -> None:
    """As in the plan, but for rays between those of its fan."""
    plan = scenes.room(4.0, 3.0)
    flat, high = made(plan, RING, "perturbation"), made(tall(plan), RING, "perturbation")
    known = np.isfinite(flat["perturbation"].values)
    assert known.sum() > 20
    off = np.abs(flat["perturbation"].values - high["perturbation"].values)[known]
    assert np.median(off) < 0.01
