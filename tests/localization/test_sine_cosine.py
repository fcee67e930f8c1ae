"""Sine and cosine without branches: those of numpy but for the last bit."""

from __future__ import annotations

import math

import numpy as np

from ambinav.localization.sine_cosine import sine_cosine
from ambinav.runtime.kernels import kernel


@kernel
def each(angle, sine, cosine):
    for i in range(angle.size):
        sine[i], cosine[i] = sine_cosine(angle[i])


def test_they_are_those_of_numpy() -> None:
    """At multiples of an eighth of a turn and beside them, in many turns, and anywhere."""
    eighths = np.arange(-80.0, 81.0) * math.pi / 4.0
    drawn = np.random.default_rng(3).uniform(-1e3, 1e3, 20_000)
    angle = np.concatenate([eighths, eighths + 1e-9, eighths - 1e-9, drawn, 1e3 * drawn])
    sine, cosine = np.empty_like(angle), np.empty_like(angle)
    each(angle, sine, cosine)
    np.testing.assert_allclose(sine, np.sin(angle), rtol=0.0, atol=3e-16)
    np.testing.assert_allclose(cosine, np.cos(angle), rtol=0.0, atol=3e-16)


def test_what_is_no_angle_has_neither() -> None:
    angle = np.array([math.nan, math.inf, -math.inf])
    sine, cosine = np.empty(3), np.empty(3)
    each(angle, sine, cosine)
    assert np.isnan(sine).all()
    assert np.isnan(cosine).all()
