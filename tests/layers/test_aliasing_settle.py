"""Aliased poses scanned where they are: exact twins are found exactly, and nothing else is."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav import environment_from_shapes
from ambinav.ambiguity import reference
from ambinav.layers.aliasing.layer import aliased_poses
from ambinav.layers.aliasing.settle import settle, settle_at
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.sensing import RangeScanner, RangeSensor

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

PERIOD = 3.37  # no multiple of the spacing


def scanner(resolution: float = 0.001, beams: int = 60, aperture: float = math.tau) -> RangeScanner:
    sensor = RangeSensor(max_range=4.0, std=0.03, resolution=resolution)
    return RangeScanner.planar(sensor, beams, aperture)


def two_rooms(sensing: RangeScanner, headings: int | None = None) -> LayerContext:
    """A room and its twin, turned by 50 degrees: no step of the beams."""
    outline = [(0, 0), (2.4, 0), (2.4, 0.7), (1.7, 0.7), (1.7, 1.4), (2.4, 1.9), (0.4, 2.2)]
    room = shapely.Polygon(outline)
    other = shapely.affinity.rotate(room, 0 if headings else 50, origin=(0, 0))
    env = environment_from_shapes([room, shapely.affinity.translate(other, PERIOD + 2)])
    return LayerContext.of(build_map(env, sensing, spacing=0.2, headings=headings), env)


@pytest.mark.parametrize(
    ("sensing", "headings"),
    [(scanner(), None), (scanner(0.1), None), (scanner(0.001, 30, 4.0), 4)],
    ids=["fine", "bins", "fan"],
)
def test_twins_are_met_exactly(sensing, headings):
    here = two_rooms(sensing, headings)
    found = aliased_poses(here, count=2).poses
    settled = settle(here, found)
    assert settled.shape == found.shape
    x, y = here.points
    left = x < 3.0
    turn = 0.0 if headings else math.radians(50)
    twin = (x + 1j * y) * np.exp(1j * turn) + PERIOD + 2
    off = np.abs(settled[..., 0] + 1j * settled[..., 1] - twin[:, None, None])
    bend = np.abs(np.angle(np.exp(1j * (settled[..., 2] - turn))))
    good = ((off < 0.005) & (bend < 0.005) & (settled[..., 3] > 0.98)).any(axis=2)
    # The search knows nearly all of them, and follows none.
    assert good[left].mean() > 0.85
    likeness = np.nan_to_num(settled[..., 3])
    assert (np.diff(likeness, axis=2) <= 0.0).all()


def test_likeness_is_that_of_two_scans():
    here = two_rooms(scanner())
    x, y = here.points
    settled = settle(here, aliased_poses(here).poses)[:, 0, 0]
    limit, cap = np.full(60, 4.0), np.full(60, -math.log(0.05))
    for p in range(0, len(x), 17):
        px, py, turn, likeness = settled[p]
        one, other = (
            reference.beams(here.environment, here.scanner, here.model, *pose)
            for pose in ((x[p], y[p], 0.0), (px, py, turn))
        )
        z = np.minimum(one[0], limit) - np.minimum(other[0], limit)
        evidence = z * z / (2 * (one[2] + other[2]))
        apart = np.sum(evidence / np.sqrt(1 + (evidence / cap) ** 2)) / here.model.tau
        # Cast at the nearest of some headings, and turned from there.
        assert likeness == pytest.approx(math.exp(-apart), abs=0.03)


def test_what_ends_nearby_or_outside_is_left_out():
    here = two_rooms(scanner())
    x, y = here.points
    cell = np.array([int(np.hypot(x - 1.0, y - 1.0).argmin())] * 2)
    alike = np.array([[x[cell[0]] + 0.1, y[cell[0]], 0.0], [-3.0, -3.0, 0.0]])
    assert np.isnan(settle_at(here, 0, cell, alike)).all()
    assert settle_at(here, 0, cell[:0], alike[:0]).shape == (0, 4)
