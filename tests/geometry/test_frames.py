from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ambinav.geometry.frames import between, compose, inverse, wrap_angles

pose = st.tuples(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3.0, 3.0))


def test_a_step_ahead_after_a_quarter_turn():
    np.testing.assert_allclose(
        compose((1.0, 2.0, math.pi / 2), (1.0, 0.0, 0.1)), (1.0, 3.0, math.pi / 2 + 0.1)
    )


@given(pose, pose)
def test_between_undoes_compose(a, b):
    np.testing.assert_allclose(between(a, compose(a, b)), b, atol=1e-9)
    np.testing.assert_allclose(compose(a, compose(inverse(a), b)), b, atol=1e-9)


def test_arrays_broadcast():
    many = np.random.default_rng(0).normal(size=(4, 5, 3))
    assert compose(many, (1.0, 0.0, 0.0)).shape == (4, 5, 3)
    np.testing.assert_allclose(between(many, many), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        wrap_angles([math.pi, -math.pi, 4.0]), [-math.pi, -math.pi, 4 - math.tau]
    )
