"""Aliased poses scanned and followed: in a building that repeats each pose has all its twins."""

from __future__ import annotations

import numpy as np
import pytest

import ambinav as an
from ambinav.layers.aliasing.layer import aliased_poses, squares
from ambinav.layers.aliasing.settle import settle
from ambinav.layers.context import LayerContext
from ambinav.studies.audit.aliasing_groups import join, neighbours, same, stepped
from ambinav.studies.audit.aliasing_tracks import LEAST_LIKENESS, follow
from tests.studies.audit import symmetric

SPACING = 0.25


def context(environment: an.Environment, scanner: an.RangeScanner) -> LayerContext:
    return LayerContext.of(an.build_map(environment, scanner, spacing=SPACING), environment)


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 4], ids=["all", "some"])
@pytest.mark.parametrize(
    ("make", "twins"),
    [
        (symmetric.crossing, symmetric.turns(4)),
        (symmetric.hexagon, symmetric.turns(6)),
        (lambda: symmetric.rooms(3), symmetric.shifts(3)),
    ],
    ids=["crossing", "hexagon", "rooms"],
)
def test_every_pose_has_its_twins(laser, make, twins, every):
    """However coarse the lattice, and though most were not searched for."""
    here = context(make(), laser)
    x, y = here.points
    row, column = squares(x, y, SPACING)
    sought = (row % every == 0) & (column % every == 0)
    found = aliased_poses(here, count=8, sought=sought).poses
    full = follow(here, settle(here, found))
    p = x + 1j * y
    for twin in twins:
        q = twin[0](p)
        due = np.abs(q - p) >= 1.5
        if twins[0][1] == 0.0:
            # In the rooms, and where there is one so far off.
            due &= (y > 1.9) & (q.real > 0) & (q.real < 3 * symmetric.PERIOD)
        assert due.sum() > 40
        # One in some hundred is scanned into a lesser optimum beside it.
        assert symmetric.have(full, p, twin)[due].mean() > 0.995


def test_less_alike_is_left_out_and_the_rest_kept(laser):
    here = context(symmetric.crossing(), laser)
    settled = settle(here, aliased_poses(here, count=5).poses)
    full = follow(here, settled)
    kept = settled[..., 3] >= LEAST_LIKENESS
    np.testing.assert_array_equal(full[kept], settled[kept])
    assert np.nanmin(full[..., 3]) >= LEAST_LIKENESS


def test_a_step_is_turned_as_the_robot_is():
    alike = np.array([[5.0, 1.0, 0.5 * np.pi, 0.9], [5.0, 1.0, -np.pi, 0.9]])
    there = stepped(0.2, alike, (1, 0))
    np.testing.assert_allclose(there[:, :2], [(5.0, 1.2), (4.8, 1.0)], atol=1e-12)
    assert same(0.2, alike[1], alike[1] + [0.0, 0.09, 2 * np.pi, 0.0])
    assert not same(0.2, alike[1], alike[1] + [0.0, 0.11, 0.0, 0.0])
    assert not same(0.2, alike[1], alike[1] + [0.0, 0.0, 0.3, 0.0])


def test_what_moves_along_is_joined(laser):
    """One region of all cells that are moved alike; a cell twice in it counts once."""
    here = context(symmetric.rooms(1), laser)
    x, y = here.points
    entries = np.full((len(x), 1, 3, 4), np.nan)[:, 0]
    entries[:, 1] = np.column_stack([x + 9.0, y, np.zeros(len(x)), np.full(len(x), 0.8)])
    entries[:, 2] = entries[:, 1] + [0.01, 0.0, 0.0, -0.1]
    upper = y > 3.0
    entries[upper, 1, 0] += 0.2
    entries[upper, 2] = np.nan
    regions = join(here, entries, np.isfinite(entries[..., 3]), 5)
    cells = sorted((tuple(cells), set(chosen)) for cells, chosen in regions)
    assert [len(one) for one, _ in cells] == [(~upper).sum()] * 2 + [upper.sum()]
    assert tuple(np.flatnonzero(upper)) in [one for one, _ in cells]
    there = neighbours(here, np.arange(len(x)), (0, 1))
    assert (y[there[there >= 0]] > y[there >= 0] + 0.5 * SPACING).all()
