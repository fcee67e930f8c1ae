"""Packets of rays: every ray is in one, and those of one packet go together."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.casting.ray_packets import MOST, WIDEST, packets_of
from ambinav.casting.space import SpaceRays

LAYERS = np.radians(np.linspace(-15.0, 15.0, 16))


def test_layers_are_columns() -> None:
    packets = packets_of(SpaceRays.layers(LAYERS, np.linspace(-3.0, 3.0, 90), 0.5))
    assert len(packets.column) == 90
    assert packets.column.all()
    assert (np.diff(packets.start) == 16).all()


def test_tilted_layers_are_few_packets() -> None:
    level = SpaceRays.layers(LAYERS, np.linspace(-3.0, 3.0, 360), 0.5)
    packets = packets_of(level.mounted(0.0, 0.0, 0.0, 0.0, 0.1, 0.05))
    assert len(packets.column) < 1.3 * len(level.azimuth) / MOST
    assert not packets.column.any()


@pytest.mark.slow
@given(seed=st.integers(0, 10_000), count=st.integers(1, 300), sensors=st.integers(1, 3))
def test_every_ray_is_in_one_packet_with_its_neighbours(
    seed: int, count: int, sensors: int
) -> None:
    rng = np.random.default_rng(seed)
    origin = rng.uniform(-1.0, 1.0, (sensors, 3))[rng.integers(sensors, size=count)]
    azimuth = rng.uniform(-7.0, 7.0, count)
    same = rng.integers(count, size=count)
    azimuth = np.where(rng.random(count) < 0.3, azimuth[same], azimuth)
    elevation = rng.choice([-math.pi / 2, math.pi / 2, *rng.uniform(-1.5, 1.5, 20)], count)
    packets = packets_of(SpaceRays(origin, azimuth, elevation))
    assert np.sort(packets.ray).tolist() == list(range(count))
    assert packets.start[0] == 0
    assert packets.start[-1] == count
    for c in range(len(packets.column)):
        part = slice(packets.start[c], packets.start[c + 1])
        which = packets.ray[part]
        assert (origin[which] == packets.origin[c]).all()
        assert (np.diff(packets.slope[part]) >= 0.0).all()
        assert packets.column[c] == (len(np.unique(azimuth[which])) == 1)
        if (np.abs(elevation[which]) > 1.55).any():
            assert len(which) == 1
        if not packets.column[c]:
            turned = np.mod(azimuth[which], 2.0 * math.pi)
            assert np.ptp(turned) <= WIDEST
            assert len(which) <= MOST
    assert np.allclose(packets.cosine, np.cos(azimuth[packets.ray]))
    assert np.allclose(
        packets.slope[packets.flat > 0], np.tan(elevation[packets.ray])[packets.flat > 0]
    )
