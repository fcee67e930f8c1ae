"""The layers before the network: any parts of the observation, and what they are for."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from gymnasium import spaces

pytest.importorskip("stable_baselines3")
import torch

from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.spaces import observation_space
from ambinav_envs.training.features import LAYERS, NavigationFeatures, looks_around

WHOLE = observation_space(NavigationParameters(waypoint=True))
PARTS = tuple(WHOLE.spaces)


def batch(space: spaces.Dict, count: int = 3) -> dict[str, torch.Tensor]:
    return {name: torch.rand(count, *part.shape) for name, part in space.spaces.items()}


@pytest.mark.parametrize("kind", LAYERS)
@pytest.mark.parametrize("names", [*itertools.combinations(PARTS, 2), PARTS], ids="-".join)
def test_any_parts(names: tuple[str, ...], kind: str) -> None:
    space = spaces.Dict({name: WHOLE[name] for name in names})
    features = NavigationFeatures(space, kind, kind, scan_features=7, window_features=9)
    made = {"scan": 7, "window": 9}
    wanted = sum(made.get(name, WHOLE[name].shape[0]) for name in names)
    assert features.features_dim == wanted
    assert features(batch(space)).shape == (3, wanted)


def test_a_row_goes_through() -> None:
    features = NavigationFeatures(spaces.Box(-1.0, 1.0, (11,)))
    seen = torch.rand(4, 11)
    assert features.features_dim == 11 and torch.equal(features(seen), seen)


def test_a_window_of_any_size() -> None:
    for cells in (1, 2, 5, 16):
        space = spaces.Dict({"window": spaces.Box(0.0, 1.0, (2 * cells**2,))})
        assert NavigationFeatures(space)(batch(space)).shape == (3, 64)


def test_beams_go_round() -> None:
    """Turned by three beams, what the convolution gives turns by one place."""
    torch.manual_seed(0)
    space = spaces.Dict({"scan": WHOLE["scan"]})
    for circular in (True, False):
        layers = NavigationFeatures(space, circular=circular).parts["scan"]
        ring, scan = layers[:-3], torch.rand(1, 60)
        plain, turned = ring(scan), ring(torch.roll(scan, 3, dims=1))
        assert plain.shape == (1, 16, 20 if circular else 19)
        wanted = plain.roll(1, dims=2)
        assert torch.allclose(turned, wanted, atol=1e-6) is circular
        assert torch.allclose(turned[..., 1:], wanted[..., 1:], atol=1e-6)


def test_which_scanners_look_around() -> None:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=0.01)

    def scanner(beams: int, aperture: float) -> RangeScanner:
        return RangeScanner.planar(sensor, beams, aperture)

    assert looks_around(scanner(60, math.tau)) and looks_around(scanner(8, math.tau))
    assert not looks_around(scanner(60, math.radians(240.0)))
    assert not looks_around(scanner(1, 0.1))


def test_few_beams_and_unknown_layers_are_refused() -> None:
    few = spaces.Dict({"scan": spaces.Box(0.0, 1.0, (4,))})
    with pytest.raises(InputError, match="need 6 beams and there are 4; choose dense"):
        NavigationFeatures(few)
    assert NavigationFeatures(few, "dense").features_dim == 64
    with pytest.raises(InputError, match="scan: 'dens' is unknown; did you mean dense"):
        NavigationFeatures(few, "dens")


def test_gradients_reach_every_weight() -> None:
    features = NavigationFeatures(WHOLE)
    features(batch(WHOLE, 16)).sum().backward()
    assert all(float(np.abs(one.grad.numpy()).max()) > 0.0 for one in features.parameters())


@pytest.mark.parametrize("circular", [True, False])
@pytest.mark.parametrize("beams", [6, 7, 8, 60, 361, 541, 682])
def test_every_beam_is_looked_at(beams: int, circular: bool) -> None:
    torch.manual_seed(0)
    space = spaces.Dict({"scan": spaces.Box(0.0, 1.0, (beams,))})
    layers = NavigationFeatures(space, circular=circular).parts["scan"][:3]
    scan = torch.rand(1, beams, requires_grad=True)
    layers(scan).sum().backward()
    assert scan.grad is not None and (scan.grad != 0.0).all()
