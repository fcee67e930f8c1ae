"""Sampling, floors and shares of a map whose every value is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.occupancy_grid import OccupancyGrid
from ambinav.localization.expected_covariance import expected_covariance
from ambinav.localization.information_gain import information_gain
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import ZONES
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.maps import synthetic

RNG_SEED = 7


@pytest.fixture(scope="module")
def flat() -> AmbiguityMap:
    return AmbiguityMap(synthetic.dataset())


@pytest.fixture(scope="module")
def turning() -> AmbiguityMap:
    return AmbiguityMap(synthetic.dataset(headings=8))


def reference(amap: AmbiguityMap, layer: str, x: float, y: float, theta: float = 0.0) -> float:
    """The definition of `sample` for a linear layer, one pose at a time."""
    data = amap.dataset[layer]
    values = data.values if "theta" in data.dims else data.values[..., None]
    values = values.astype(np.float64)
    free = amap.dataset["free"].values
    x0, y0 = amap.dataset["x"].values[0], amap.dataset["y"].values[0]
    u, v = (x - x0) / amap.spacing, (y - y0) / amap.spacing
    ny, nx, nt = values.shape
    column, row = math.floor(u + 0.5), math.floor(v + 0.5)
    if not (0 <= column < nx and 0 <= row < ny) or not free[row, column]:
        return math.nan
    w = theta / (2 * math.pi) * nt
    total = weights = 0.0
    for r in (math.floor(v), math.floor(v) + 1):
        for c in (math.floor(u), math.floor(u) + 1):
            for t in (math.floor(w), math.floor(w) + 1):
                weight = max(0, 1 - abs(u - c)) * max(0, 1 - abs(v - r)) * max(0, 1 - abs(w - t))
                if 0 <= c < nx and 0 <= r < ny and not math.isnan(values[r, c, t % nt]):
                    total += weight * values[r, c, t % nt]
                    weights += weight
    return total / weights


@pytest.mark.parametrize("layer", ["level", "major_radius"])
def test_sample_agrees_with_its_definition(flat, turning, layer):
    rng = np.random.default_rng(RNG_SEED)
    x, y, theta = rng.uniform(-1, 27, 400), rng.uniform(-1, 11, 400), rng.uniform(-9, 9, 400)
    for amap in (flat, turning):
        expected = [reference(amap, layer, *pose) for pose in zip(x, y, theta, strict=True)]
        np.testing.assert_allclose(amap.sample(layer, x, y, theta), expected, atol=1e-6)
    assert 0.2 < np.isnan(expected).mean() < 0.8


def test_sample_agrees_with_xarray_away_from_walls():
    # A layer that varies everywhere, all of it free, against scipy's interpolation.
    dataset = synthetic.dataset()
    rng = np.random.default_rng(RNG_SEED)
    dataset["free"][:] = True
    dataset["level"].values[:] = rng.random(dataset["level"].shape)
    x, y = rng.uniform(0, 26, 300), rng.uniform(0, 10, 300)
    expected = dataset["level"].interp(x=("p", x), y=("p", y)).values
    np.testing.assert_allclose(AmbiguityMap(dataset).sample("level", x, y), expected, atol=1e-6)


def test_sample_reproduces_a_plane_exactly():
    dataset = synthetic.dataset()
    gx, gy = np.meshgrid(dataset["x"], dataset["y"])
    dataset["free"][:] = True
    dataset["level"].values[:] = 0.01 * gx + 0.02 * gy
    amap = AmbiguityMap(dataset)
    assert amap.sample("level", 3.217, 4.481) == pytest.approx(0.03217 + 0.08962, abs=1e-6)


def test_heading_is_periodic(turning):
    at = turning.sample("level", 10.0, 2.0, np.array([0.1, 0.1 + 2 * math.pi, 0.1 - 6 * math.pi]))
    np.testing.assert_allclose(at, at[0], atol=1e-6)
    # Halfway between the last heading (315 degrees) and the first: the mean of both.
    last, first = (turning.sample("level", 10.0, 2.0, a) for a in (7 * math.pi / 4, 0.0))
    between = turning.sample("level", 10.0, 2.0, 15 * math.pi / 8)
    assert between == pytest.approx((last + first) / 2, abs=1e-6)


def test_without_heading_the_mean_is_read(turning):
    mean = turning.sample("level_mean", 10.0, 2.0)
    assert turning.sample("level", 10.0, 2.0) == mean
    assert turning.sample("level", 10.0, 2.0, 0.0) < mean


def test_a_map_without_headings_is_the_same_for_all(flat):
    assert flat.sample("level", 10.0, 2.0, 1.3) == flat.sample("level", 10.0, 2.0)


def test_nan_in_walls_and_outside(flat):
    outside = [(-0.3, 1.0), (10.0, 5.0), (-50.0, 0.0), (1e9, 0.0), (math.nan, 1.0), (math.inf, 1.0)]
    for x, y in outside:
        assert math.isnan(flat.sample("level", x, y)), (x, y)
        assert math.isnan(flat.sample("zone", x, y)), (x, y)
        assert math.isnan(flat.sample("direction", x, y)), (x, y)
        assert flat.sample("free", x, y) == 0.0, (x, y)
    assert flat.sample("free", 10.0, 2.0) == 1.0


def test_nan_heading_gives_nan_only_where_heading_matters(flat, turning):
    assert math.isnan(turning.sample("level", 10.0, 2.0, math.nan))
    assert turning.sample("level_mean", 10.0, 2.0, math.nan) > 0.0
    assert flat.sample("level", 10.0, 2.0, math.nan) == pytest.approx(0.5)


def test_beside_a_wall_the_free_corners_decide(flat):
    # The corridor's wall is at y = 1, cell centres at 0.95 (wall) and 1.05 (free).
    assert flat.sample("level", 10.0, 1.01) == pytest.approx(0.5, abs=1e-6)
    assert math.isnan(flat.sample("level", 10.0, 0.99))


def test_float_in_float_out_and_broadcasting(flat):
    assert type(flat.sample("level", 10.0, 2.0)) is float
    assert type(flat.sample("level", 10, 2)) is float
    assert flat.sample("level", np.zeros((4, 1)), np.zeros(3)).shape == (4, 3)
    assert flat.sample("level", [10.0], 2.0).shape == (1,)
    assert flat.sample("level", np.zeros(0), 2.0).shape == (0,)


def test_direction_is_an_axis():
    # 178 and 2 degrees are four degrees apart: in between lies 0, not 90.
    dataset = synthetic.dataset()
    angles = np.where(dataset["x"].values < 10.0, math.radians(178.0), math.radians(2.0))
    dataset["direction"].values[:] = angles
    amap = AmbiguityMap(dataset)
    middle = amap.sample("direction", 10.0, 2.0)
    assert min(middle, math.pi - middle) < 1e-6
    got = amap.sample("direction", np.linspace(9.8, 10.2, 41), 2.0)
    assert ((got >= 0.0) & (got < math.pi)).all()
    assert not ((got > math.radians(3.0)) & (got < math.radians(177.0))).any()


def test_zone_is_read_from_the_nearest_cell(flat):
    x = np.linspace(0.5, 25.5, 301)
    zone = flat.sample("zone", x, 2.0)
    assert set(zone) <= {0.0, 1.0, 2.0, 3.0}
    assert flat.sample("zone", 21.0, 5.0) == ZONES.index("open")


def test_unknown_layer_offers_the_nearest_names(flat):
    with pytest.raises(InputError, match=r"'levle'.*did you mean level"):
        flat.sample("levle", 1.0, 1.0)
    with pytest.raises(InputError, match="no such layer"):
        flat.floor("xyzzy")
    # Not what it is nearest to by letters, where it could be there.
    with pytest.raises(InputError, match="or one that `ambinav map --layers` makes"):
        flat.floor("position")


def test_a_layer_without_mean_needs_a_heading(turning):
    dataset = turning.dataset.copy()
    dataset["heading"] = dataset["level"]
    amap = AmbiguityMap(dataset)
    assert amap.sample("heading", 10.0, 2.0, 0.0) == amap.sample("level", 10.0, 2.0, 0.0)
    with pytest.raises(InputError, match="give theta"):
        amap.sample("heading", 10.0, 2.0)
    with pytest.raises(InputError, match="give an angle"):
        amap.floor("heading")


def test_floor(flat, turning):
    assert flat.floor("level", "worst").identical(flat.dataset["level"])
    for heading in ("mean", "best", "worst"):
        assert turning.floor("level", heading).identical(turning.dataset[f"level_{heading}"])
    at = turning.floor("level", 0.0)
    assert at.dims == ("y", "x")
    np.testing.assert_allclose(at, turning.dataset["level"].isel(theta=0), atol=1e-6)
    assert turning.floor("zone", 0.3).dtype == np.uint8
    assert (turning.floor("zone", 0.3).values == turning.dataset["zone_mean"].values).all()


def test_floor_of_a_layer_without_stored_aggregate_follows_the_level(turning):
    # Level is lowest at heading 0 and highest at pi: the fifth of eight.
    for heading, index in (("best", 0), ("worst", 4)):
        without = AmbiguityMap(turning.dataset.drop_vars(f"major_radius_{heading}"))
        got = without.floor("major_radius", heading)
        expected = turning.dataset["major_radius"].isel(theta=index)
        np.testing.assert_array_equal(got.values, expected.values)


@pytest.mark.parametrize("heading", ["median", math.nan, math.inf])
def test_floor_refuses_other_headings(turning, heading):
    with pytest.raises(InputError, match="heading"):
        turning.floor("level", heading)


def test_zone_shares_are_the_areas_of_the_plan(flat, turning):
    for amap in (flat, turning):
        shares = {share.zone: share for share in amap.zone_shares()}
        assert tuple(shares) == ZONES
        assert shares["open"].area == pytest.approx(6 * 6)
        assert shares["corridor"].area == pytest.approx(11 * 2 + 4 * 6 * 2)
        assert shares["transition"].area == pytest.approx(2 * 0.5 * 2)
        assert shares["localizable"].area == pytest.approx(4 * 4 + 4 * 2 * 2)
        assert sum(share.share for share in shares.values()) == pytest.approx(1.0)
        assert amap.free_area == pytest.approx(16 + 24 + 100)


def test_bounds_spacing_segments_repr(flat, turning):
    assert flat.spacing == pytest.approx(0.1)
    assert flat.bounds == pytest.approx((-0.5, -0.5, 26.5, 10.5))
    assert len(flat.segments) == 12
    assert flat.segments.walls.sum() == 11
    assert not flat.has_theta
    assert turning.has_theta
    assert "synthetic" in repr(flat)
    assert "x 8 headings" in repr(turning)


def test_a_map_one_cell_wide_takes_the_spacing_from_its_parameters():
    amap = AmbiguityMap(synthetic.dataset().isel(x=slice(100, 101)))
    assert amap.spacing == pytest.approx(0.1)
    assert amap.sample("level", float(amap.dataset["x"][0]) + 0.04, 2.0) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: d.drop_vars(["level", "segments"]), "lacks level, segments"),
        (lambda d: d.drop_attrs(deep=False), "lacks attribute environment"),
        (lambda d: d.assign_coords(x=d["x"] ** 2), "equal steps"),
        (lambda d: d.assign_coords(x=d["x"] * np.nan), "finite"),
        (lambda d: d.assign(level=d["level"].transpose("x", "y")), "layer level"),
    ],
)
def test_what_is_no_map_is_refused(spoil, message):
    with pytest.raises(InputError, match=message):
        AmbiguityMap(spoil(synthetic.dataset()))


def test_environment_is_the_building() -> None:
    amap = AmbiguityMap(synthetic.dataset())
    env = amap.environment
    assert env.bounds == (0.0, 0.0, 26.0, 10.0)
    assert env.name == "synthetic"
    assert env.free.area == pytest.approx(16.0 + 24.0 + 100.0)
    assert env.is_free([2.0, 2.0, 10.0], [2.0, 6.0, 2.0], radius=0.5).tolist() == [
        True,
        False,
        True,
    ]
    np.testing.assert_array_equal(env.segments.kind, amap.segments.kind)


def test_damaged_outline_is_refused() -> None:
    dataset = synthetic.dataset()
    dataset["floor"] = (("byte",), dataset["floor"].values[:20])
    with pytest.raises(InputError, match="floor, the outline of the free space"):
        _ = AmbiguityMap(dataset).environment


@pytest.mark.slow
def test_the_map_knows_how_sure_its_walls_are() -> None:
    """What is computed from a map is what comes of the building that it was computed from."""
    state = np.zeros((60, 80), dtype=np.uint8)
    state[[0, -1]] = state[:, [0, -1]] = 1
    building = environment_from_grid(OccupancyGrid(state, 0.05))
    scanner = RangeScanner.planar(
        sensor=RangeSensor(max_range=4.0, std=0.02, resolution=0.01), beams=24, aperture=math.tau
    )
    amap = build_map(building, scanner, spacing=0.2)
    kept = amap.environment
    assert kept.resolution == building.resolution and kept.map_std == building.map_std
    poses = [[1.0, 1.0, 0.0], [2.0, 1.5, 0.3]]
    there = expected_covariance(amap, poses, source="fisher")
    here = expected_covariance(building, poses, source="fisher", scanner=scanner)
    np.testing.assert_allclose(here, there, rtol=1e-9)
    gains = [
        information_gain(place, scanner, poses, np.diag([0.04, 0.04, 0.01])).total
        for place in (amap, building)
    ]
    assert gains[0] == pytest.approx(gains[1], rel=1e-9)
    assert information_gain(amap, None, poses, np.diag([0.04, 0.04, 0.01])).total == gains[0]


@pytest.mark.slow
def test_what_a_map_was_made_with_counts_in_what_is_computed_from_it() -> None:
    """Walls that are given as less sure than the building's kind says are so everywhere."""
    building = environment_from_shapes([shapely.box(0, 0, 4, 3)])
    scanner = RangeScanner.planar(
        sensor=RangeSensor(max_range=5.0, std=0.02, resolution=0.01), beams=24, aperture=math.tau
    )
    amap = build_map(building, scanner, spacing=0.5, map_std=0.1)
    poses, prior = [[1.0, 1.0, 0.0]], np.diag([0.04, 0.04, 0.01])
    options = {"prior": prior, "map_std": 0.1}
    there = expected_covariance(amap, poses, source="fisher", prior=prior)
    here = expected_covariance(building, poses, scanner=scanner, **options)
    np.testing.assert_allclose(there, here, rtol=1e-9)
    gain = information_gain(amap, None, poses, prior).total
    assert gain == pytest.approx(
        information_gain(building, scanner, poses, **options).total, rel=1e-9
    )
    small = information_gain(amap, None, poses, prior, map_std=0.02).total
    assert small > gain + 1.0
