"""Cost in space: against interpolation and sums that share no code with it."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import xarray as xr
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ambinav.maps.ambiguity_volume import AmbiguityVolume
from ambinav.runtime.errors import InputError
from ambinav.service.volume_service import VolumeService

ORIGIN, STEPS, SHAPE = (-1.1, 2.3, 0.5), (0.2, 0.2, 0.4), (4, 9, 12)


def volume(free: NDArray[np.bool_] | None = None) -> AmbiguityVolume:
    """Random levels at four heights from 0.5 to 1.7 m; no value where it is not free."""
    level = np.random.default_rng(5).uniform(0.0, 1.0, SHAPE).astype(np.float32)
    free = np.ones(SHAPE, dtype=np.bool_) if free is None else free
    axes = {
        name: ORIGIN[k] + STEPS[k] * np.arange(SHAPE[2 - k])
        for k, name in enumerate(("x", "y", "z"))
    }
    layers = {"level": np.where(free, level, np.nan), "free": free}
    return AmbiguityVolume(
        xr.Dataset(
            {name: (("z", "y", "x"), values) for name, values in layers.items()},
            axes,
            {"environment": "e", "scanner": "s", "parameters": "{}"},
        )
    )


def interpolated(made: AmbiguityVolume, points: NDArray[np.float64]) -> NDArray[np.float64]:
    places = [(points[:, k] - ORIGIN[k]) / STEPS[k] for k in (2, 1, 0)]
    values = 1.0 + 6.0 * made.dataset["level"].values.astype(float)
    return np.asarray(map_coordinates(values, places, order=1, mode="nearest"))


def test_cost_is_trilinear_and_at_least_one() -> None:
    service = VolumeService(volume(), weight=6.0)
    points = np.random.default_rng(1).uniform((-1.1, 2.3, 0.5), (1.1, 3.9, 1.7), (300, 3))
    points[:4, 2] = 0.5, 1.7, 0.9, 1.3
    cost = service.cost(*points.T)
    np.testing.assert_allclose(cost, interpolated(service.volume, points), rtol=1e-5)
    assert np.min(cost) >= 1.0
    assert service.cost(-1.1, 2.3, 1.7) == pytest.approx(cost_of_corner(service.volume), rel=1e-5)
    assert service.cost(-5.0, 2.3, 1.0) == math.inf


def cost_of_corner(made: AmbiguityVolume) -> float:
    return 1.0 + 6.0 * float(made.dataset["level"].values[3, 0, 0])


def test_motions_cost_what_a_quadrature_says() -> None:
    service = VolumeService(volume(), weight=6.0)
    rng = np.random.default_rng(2)
    ends = rng.uniform((-1.1, 2.3, 0.5), (1.1, 3.9, 1.7), (40, 2, 3))
    ends[0, 1, :2] = ends[0, 0, :2]
    ends[1, :, 2] = 1.7
    ends[2, :, 2] = 0.5, 1.7
    share = (np.arange(20_000) + 0.5) / 20_000
    for a, b in ends:
        length = math.dist(a, b)
        expected = interpolated(service.volume, a + (b - a) * share[:, None]).mean() * length
        assert service.route_cost([a, b]) == pytest.approx(expected, rel=1e-5)
        assert service.route_cost([a, b]) >= length
        assert service.route_cost([b, a]) == pytest.approx(service.route_cost([a, b]), rel=1e-9)
    route = ends.reshape(-1, 3)
    parts = sum(service.route_cost(pair) for pair in itertools.pairwise(route))
    assert service.route_cost(route) == pytest.approx(parts)


def test_what_is_not_free_costs_infinitely_much_and_is_filled_from_the_nearest() -> None:
    free = np.ones(SHAPE, dtype=np.bool_)
    free[1:, 4, 6] = False
    service = VolumeService(volume(free), weight=6.0)
    x, y = ORIGIN[0] + 6 * 0.2, ORIGIN[1] + 4 * 0.2
    assert service.cost(x, y, 0.9) == math.inf
    assert service.cost(x, y, 0.5) < math.inf
    assert np.isfinite(service.density).all()


@pytest.mark.parametrize("z", [0.4, 1.8, math.nan])
def test_heights_outside(z: float) -> None:
    service = VolumeService(volume())
    message = r"z is .* m and the volume covers heights from 0\.5 to 1\.7 m; give a height within"
    with pytest.raises(InputError, match=message):
        service.cost(0.0, 3.0, z)
    if math.isfinite(z):
        with pytest.raises(InputError, match=message):
            service.route_cost([(0.0, 3.0, 1.0), (0.0, 3.0, z)])


def test_what_is_no_volume_and_no_layer() -> None:
    made = volume()
    with pytest.raises(InputError, match=r"layer is 'levl'; give one of level"):
        VolumeService(made, "levl")
    other = AmbiguityVolume(made.dataset.assign(gain=made.dataset.level.assign_attrs(worse="low")))
    with pytest.raises(InputError, match="'gain' is high where a robot is well localized"):
        VolumeService(other, "gain")
    with pytest.raises(InputError, match="weight is -1"):
        VolumeService(made, weight=-1.0)
    below = AmbiguityVolume(made.dataset.assign(gain=-made.dataset.level - 1.0))
    with pytest.raises(InputError, match=r"'gain' holds -[12].*; a cost needs a layer that is fin"):
        VolumeService(below, "gain")
    with pytest.raises(
        InputError, match=r"weight 1e\+300 makes costs of layer 'level' that are not"
    ):
        VolumeService(made, weight=1e300)
    with pytest.raises(InputError, match="not an ambiguity volume, it lacks free; make one with"):
        AmbiguityVolume(made.dataset.drop_vars("free"))
    with pytest.raises(InputError, match="points are not rows of three finite numbers"):
        VolumeService(made).route_cost([(0.0, 1.0)])
