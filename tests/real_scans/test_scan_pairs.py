"""Which scans make a pair."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from real_scans.scan_pairs import scan_pairs

from ambinav.runtime.errors import InputError
from tests.real_scans.rooms import environment, log_of

POSES = [(1, 1, 0), (1.5, 1, 0.2), (1.5, 1.3, 2.0), (3.9, 1, 0), (4.3, 1, 0), (1.0, 1.0, 0.0)]
# A wall from below parts the fourth pose from the fifth.
PARTED = shapely.Polygon([(0, 0), (4, 0), (4, 2), (4.1, 2), (4.1, 0), (6, 0), (6, 3), (0, 3)])


def found(**options):
    env = environment(PARTED)
    log = log_of(env, POSES)
    pairs = scan_pairs(log, np.ones(6, dtype=bool), env, 1.0, **options)
    return pairs, set(zip(pairs.first.tolist(), pairs.second.tolist(), strict=True))


def test_near_unparted_and_alike_in_heading():
    pairs, both = found()
    assert both == {(0, 1), (1, 0), (1, 5), (5, 1)}
    assert (np.diff(pairs.first) >= 0).all()
    at = both_index(pairs, 0, 1)
    np.testing.assert_allclose(pairs.apart[at], (0.5, 0.0))
    assert pairs.turn[at] == pytest.approx(0.2)
    assert pairs.distance[at] == pytest.approx(0.5)


def both_index(pairs, p, q):
    return int(np.flatnonzero((pairs.first == p) & (pairs.second == q))[0])


def test_any_heading_and_no_distance():
    _, both = found(turn=np.pi, nearest=0.0)
    assert {(0, 5), (5, 0), (0, 2), (2, 1)} <= both
    assert (3, 4) not in both


def test_only_chosen_scans():
    env = environment(PARTED)
    log = log_of(env, POSES)
    chosen = np.arange(6) != 1
    assert len(scan_pairs(log, chosen, env, 1.0)) == 0
    assert len(scan_pairs(log, np.zeros(6, dtype=bool), env, 1.0)) == 0


def test_a_radius_that_is_none_is_refused():
    env = environment(PARTED)
    with pytest.raises(InputError, match="nearest < radius"):
        scan_pairs(log_of(env, POSES), np.ones(6, dtype=bool), env, 0.05)
