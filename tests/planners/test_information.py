"""Information of a scan from the radii of a map, against matrices that are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
import xarray as xr

from ambinav.errors import InputError
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav_planners.information import Information
from tests.maps.synthetic import dataset

IN_ROOM, IN_CORRIDOR, IN_HALL = [2.0, 2.0, 0.0], [10.0, 2.0, 0.0], [21.0, 5.0, 0.0]


def with_tensor(
    posterior: np.ndarray, prior: np.ndarray, turn: tuple[float, float] | None = None
) -> AmbiguityMap:
    """A map with the same Gaussians everywhere, with axes in common."""
    data = dataset()
    variance, axes = np.linalg.eigh(posterior)
    free = np.sqrt([axes[:, k] @ prior @ axes[:, k] for k in range(2)])
    radius = np.sqrt(variance)
    layers = {
        "major_radius": radius[1],
        "minor_radius": radius[0],
        "major": radius[1] / free[1],
        "minor": radius[0] / free[0],
        "direction": math.atan2(axes[1, 1], axes[0, 1]) % math.pi,
    }
    if turn is not None:
        layers |= {"heading_radius": turn[0], "heading": turn[0] / turn[1]}
    for name, value in layers.items():
        full = np.where(data["free"].values, value, np.nan).astype(np.float32)
        data[name] = xr.DataArray(full, dims=("y", "x"))
    return AmbiguityMap(data)


def test_prior_and_information_make_the_posterior() -> None:
    """Gaussians fused: posterior^-1 = prior^-1 + information, whatever the direction."""
    told = np.array([[90.0, 25.0], [25.0, 40.0]])
    prior = 0.0625 * np.eye(2)  # a round neighbourhood of 0.5 m
    posterior = np.linalg.inv(np.linalg.inv(prior) + told)
    found = Information.of(with_tensor(posterior, prior), finest=0.01).at(np.array([IN_ROOM]))
    np.testing.assert_allclose(found[0, :2, :2], told, rtol=1e-4)
    np.testing.assert_array_equal(found[0, 2], 0.0)


def test_a_scan_that_changes_nothing_tells_nothing() -> None:
    prior = 0.0625 * np.eye(2)
    found = Information.of(with_tensor(prior, prior, (1.8, 1.8))).at(np.array([IN_ROOM]))
    np.testing.assert_allclose(found, 0.0, atol=1e-4)


def test_heading() -> None:
    prior = 0.0625 * np.eye(2)
    amap = with_tensor(prior / 2, prior, (0.1, 1.8))
    found = Information.of(amap).at(np.array([IN_ROOM]))
    assert found[0, 2, 2] == pytest.approx(1 / 0.1**2 - 1 / 1.8**2, rel=1e-5)
    assert Information.of(amap, finest_heading=0.2).at(np.array([IN_ROOM]))[
        0, 2, 2
    ] == pytest.approx(25.0)


def test_corridor_tells_across_only() -> None:
    found = Information.of(AmbiguityMap(dataset())).at(np.array([IN_ROOM, IN_CORRIDOR, IN_HALL]))
    room, corridor, hall = found
    # Radii are a quarter of the ratios; the finest scan is half of the spacing of 0.1 m.
    assert corridor[0, 0] == pytest.approx((1 - 0.81) / 0.225**2, rel=1e-5)
    assert corridor[1, 1] == pytest.approx(400.0)
    assert room[0, 0] == pytest.approx(400.0)
    assert hall[1, 1] < 4.0
    assert abs(corridor[0, 1]) < 1e-4


def test_positive_semidefinite_and_weakest_everywhere() -> None:
    information = Information.of(AmbiguityMap(dataset()))
    rng = np.random.default_rng(1)
    poses = rng.uniform([0, 0, -4], [26, 10, 4], (500, 3))
    found = information.at(poses)
    values = np.linalg.eigvalsh(found[:, :2, :2])
    assert values.min() >= -1e-4
    assert np.isfinite(found).all()
    # At the centres of cells the weakest direction is stored.
    row, column = np.argwhere(AmbiguityMap(dataset()).dataset["free"].values)[::97].T
    data = dataset()
    centres = np.column_stack([data["x"].values[column], data["y"].values[row], 0.0 * row])
    np.testing.assert_allclose(
        np.linalg.eigvalsh(information.at(centres)[:, :2, :2])[:, 0],
        information.weak[row, column, 0],
        rtol=1e-4,
        atol=1e-4,
    )


def test_map_with_headings_is_read_at_the_heading() -> None:
    information = Information.of(AmbiguityMap(dataset(8)))
    ahead, back = information.at(np.array([[10.0, 2.0, 0.0], [10.0, 2.0, math.pi]]))
    # Looking along +x the radii are half as large: major is 0.45 and not 0.9 there.
    assert ahead[0, 0] == pytest.approx((1 - 0.45**2) / (0.25 * 0.45) ** 2, rel=1e-5)
    assert back[0, 0] == pytest.approx((1 - 0.81) / 0.225**2, rel=1e-5)
    np.testing.assert_array_equal([ahead[2, 2], back[2, 2]], 0.0)


@pytest.mark.parametrize(("name", "value"), [("finest", 0.0), ("finest_heading", math.nan)])
def test_bad_input(name: str, value: float) -> None:
    with pytest.raises(InputError, match=name):
        Information.of(AmbiguityMap(dataset()), **{name: value})
