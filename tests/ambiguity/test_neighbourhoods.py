"""Poses computed apart are those of the whole map."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ambinav as an
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import standing_lattice
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.neighbourhoods import Neighbourhoods, disc
from ambinav.ambiguity.returns import panorama_returns
from ambinav.ambiguity.tensor import relative_radii
from ambinav.geometry.lattice import Lattice
from tests.geometry import scenes

SPACING, RADIUS = 0.1, 0.5


@pytest.mark.slow
@pytest.mark.parametrize("aperture", [2 * math.pi, math.pi])
@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 1000))
def test_chosen_poses_are_those_of_the_map(aperture: float, seed: int) -> None:
    env = scenes.scene(seed % 7, size=6.0, blocks=4, thin=2)
    sensor = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
    scanner = an.RangeScanner.planar(sensor, 24, aperture)
    headings = np.zeros(1) if scanner.looks_all_around else 2 * math.pi * np.arange(8) / 8
    amap = an.build_map(env, scanner, SPACING, RADIUS, store=False)
    model = AmbiguityModel(radius=RADIUS, map_std=env.map_std, tau=independent_tau(scanner))
    lattice, possible = standing_lattice(Lattice.over(env, SPACING), scanner, headings)
    chosen = np.random.default_rng(seed).random(len(possible)) < 0.02
    chosen[0] = True
    around = Neighbourhoods.around(lattice, possible, chosen, RADIUS)
    table = BeamTable.of(scanner, model.map_std, model.outlier_share)
    x, y = around.lattice.points
    data = np.empty((len(headings), len(x), 5, len(table.limit)), dtype=np.float32)
    panorama_returns(env, scanner, table, x, y, headings, data)
    level = relative_radii(around.sums(data, table, model))["level"]
    expected = amap.dataset["level"].values[lattice.free][chosen].reshape(level.shape)
    np.testing.assert_allclose(level, expected, atol=1e-6)
    assert (around.among[around.poses] == np.flatnonzero(chosen)).all()


def test_a_disc_holds_what_lies_within_its_radius() -> None:
    steps = disc(0.5, 0.1)
    assert (np.hypot(*steps.T) <= 5).all()
    assert len(steps) == 81
