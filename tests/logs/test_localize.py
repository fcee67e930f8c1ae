"""A log localized in a map: where it starts, what it gives, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.logs.localize import SPARSE_SCANS, localize
from ambinav.logs.replay import replay
from ambinav.runtime.errors import InputError
from tests.logs.logs import room

FEW = MclParameters(**{**vars(SPARSE_SCANS), "max_particles": 500, "likelihood_resolution": 0.05})


@pytest.fixture(scope="module")
def square():
    return environment_from_shapes([shapely.box(0.0, 0.0, 4.0, 4.0)])


def rng(seed=3):
    return np.random.default_rng(seed)


def test_it_is_a_replay_of_the_localizer(square):
    log = room(6)
    found = localize(log, square, FEW, rng=rng(), runs=2, start_std=(0.05, 0.05, 0.02))
    localizer = MonteCarloLocalizer(square, log.scanner(), FEW, runs=2, rng=rng())
    localizer.start(log.poses[0], np.diag(np.square((0.05, 0.05, 0.02))))
    expected = replay(log, localizer)
    np.testing.assert_array_equal(found.estimates, expected.estimates)
    assert found.errors().position_max < 0.1
    assert not found.lost.any()
    assert not np.array_equal(found.estimates[0], found.estimates[1])


def test_a_log_without_poses_needs_a_start(square):
    log = room(4)
    bare = replace(log, poses=None)
    with pytest.raises(InputError, match="the log has no poses besides its odometry"):
        localize(bare, square, FEW, rng=rng())
    found = localize(bare, square, FEW, rng=rng(), start=log.poses[0])
    assert found.estimates.shape == (1, 4, 3)
    np.testing.assert_allclose(found.estimates[0, :, :2], log.poses[:, :2], atol=0.1)


def test_a_log_from_elsewhere_is_refused(square):
    log = room(10)
    away = replace(log, poses=log.poses + np.array([50.0, 0.0, 0.0]))
    with pytest.raises(
        InputError,
        match=r"log 'room': 0 of its 10 poses lie in the free space of environment .* from "
        r"\(0\.0, 0\.0\) to \(4\.0, 4\.0\) m; pose 0, \(51\.00, 1\.20\) m, does not: give the map",
    ):
        localize(away, square, FEW, rng=rng())
    # A few poses within a wall do no harm.
    some = log.poses.copy()
    some[5:, 0] += 50.0
    replace(log, poses=some).check_environment(square)
    some[4, 0] += 50.0
    with pytest.raises(InputError, match=r"4 of its 10 poses .* pose 4, "):
        replace(log, poses=some).check_environment(square)


@pytest.mark.parametrize("start", [(9.0, 1.0, 0.0), (1.0, 1.0), (np.nan, 1.0, 0.0)])
def test_bad_starts(square, start):
    with pytest.raises(InputError, match=r"the replay's start, .* is not x, y, theta in the free"):
        localize(room(2), square, FEW, rng=rng(), start=start)


@pytest.mark.parametrize("std", [(0.1, 0.1), (0.1, -0.1, 0.1), (0.1, 0.1, np.inf)])
def test_bad_deviations(square, std):
    with pytest.raises(InputError, match=r"start_std is .*; give the deviations of x, y and head"):
        localize(room(2), square, FEW, rng=rng(), start_std=std)
