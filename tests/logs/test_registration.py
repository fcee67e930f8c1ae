"""Frames of a log and of a map distinguished by the scans: motions that are known beforehand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.geometry.frames import between, compose
from ambinav.logs.registration import register
from ambinav.runtime.errors import InputError
from tests.logs.logs import room

LOG = room(12, beams=90)


def square() -> Environment:
    return environment_from_shapes([shapely.box(0.0, 0.0, 4.0, 4.0)])


def test_a_log_in_the_frame_of_the_map_stays():
    found = register(LOG, square())
    np.testing.assert_allclose(found.motion, 0.0, atol=2e-3)
    assert found.before < 1e-3
    assert found.after < 3e-3
    np.testing.assert_allclose(found.applied(LOG).poses, LOG.poses, atol=1e-2)


shift = st.floats(-0.3, 0.3)


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(shift, shift, st.floats(-0.1, 0.1))
def test_a_frame_that_was_moved_is_found(x, y, theta):
    frame = (x, y, theta)
    moved = replace(LOG, poses=compose(frame, LOG.poses))
    found = register(moved, square())
    np.testing.assert_allclose(compose(found.motion, frame), 0.0, atol=5e-3)
    assert np.abs(between(LOG.poses, found.applied(moved).poses)).max() < 0.015
    assert found.after < 0.01


def test_what_the_map_does_not_know_weighs_little():
    # A fifth of the beams end at people half-way to the wall.
    ranges = LOG.ranges.copy()
    people = np.random.default_rng(1).random(ranges.shape) < 0.2
    ranges[people] *= 0.5
    frame = (0.2, -0.1, 0.05)
    moved = replace(LOG, ranges=ranges, poses=compose(frame, LOG.poses))
    np.testing.assert_allclose(compose(register(moved, square()).motion, frame), 0.0, atol=0.01)


def test_what_cannot_be_laid_on_a_map():
    with pytest.raises(InputError, match="the log has no poses"):
        register(replace(LOG, poses=None), square())
    with pytest.raises(InputError, match="0 of its 12 poses lie in the free space"):
        register(replace(LOG, poses=LOG.poses + np.array([9.0, 0.0, 0.0])), square())
    with pytest.raises(InputError, match="no beam of it returns from less than 15 m"):
        register(replace(LOG, ranges=np.full_like(LOG.ranges, np.inf)), square())
