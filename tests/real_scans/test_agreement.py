"""Comparing pairs: against the model's plain reference, and its figures against the lattice's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from real_scans.agreement import pose_figures
from real_scans.compared import SPACING, compared, in_view
from real_scans.log_split import as_seen_from_laser, scanner_of
from real_scans.scan_pairs import scan_pairs

from ambinav.ambiguity import reference
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER, WALL, Segments
from tests.real_scans.rooms import HALF_TURN, environment, log_of

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

MODEL = AmbiguityModel(radius=0.5, map_std=0.05, tau=4.0)
POSES = np.array([(19.9, 1.03, 0.0), (20.4, 1.0, 0.0), (20.2, 1.5, 0.0), (6.0, 1.0, 0.0),
                  (6.5, 1.0, 0.0), (6.5, 1.2, 0.0)])  # fmt: skip


def study(noise=0.0, max_range=4.0, poses=POSES):
    env = environment()
    log = as_seen_from_laser(log_of(env, poses, noise=noise))
    pairs = scan_pairs(log, np.ones(len(poses), dtype=bool), env, 1.0)
    scanner = scanner_of(log, max_range)
    return env, scanner, pairs, compared(log, pairs, env, scanner, MODEL)


def test_prediction_is_the_reference_of_the_model():
    env, scanner, pairs, found = study()
    limit = np.full(scanner.beams, 4.0)
    cap = np.full(scanner.beams, -math.log(MODEL.outlier_share + 0.01))
    C = np.diag([SPACING**2 / 4, SPACING**2 / 4, MODEL.sigma_theta**2])
    scans = [reference.beams(env, scanner, MODEL, *pose) for pose in POSES]
    for k, (p, q) in enumerate(zip(pairs.first, pairs.second, strict=True)):
        alike, offset, S = reference.compare(scans[p], scans[q], limit, cap, MODEL.tau, C)
        np.testing.assert_allclose(found.predicted.alike[k], alike, rtol=2e-3)
        np.testing.assert_allclose(found.predicted.offset[k], offset[:2], atol=1e-4)
        np.testing.assert_allclose(
            found.predicted.spread[k], (S[0, 0], S[0, 1], S[1, 1]), atol=1e-6
        )


def test_exact_scans_measure_what_the_map_predicts():
    _, _, _, found = study()
    np.testing.assert_allclose(
        np.log(found.measured.alike), np.log(found.predicted.alike), rtol=0.2, atol=0.3
    )


def test_readings_from_where_the_map_is_unknown_do_not_count_among_the_known_beams():
    walls = environment()
    np.testing.assert_array_equal(study()[3].known.alike, study()[3].measured.alike)
    kind = np.where(walls.segments.xy[:, [0, 2]].min(axis=1) > 23.9, FRONTIER, WALL)
    assert (kind == FRONTIER).sum() == 1
    env = Environment(Segments(walls.segments.xy, kind.astype(np.uint8)), walls.free, name="open")
    log = as_seen_from_laser(log_of(env, POSES))
    x, y, theta = POSES.T[:, :, None]
    _, segment = env.cast_hits(x, y, theta + log.angles, 30.0)
    beyond = kind[segment] == FRONTIER
    # Beside them are beams whose slope would be drawn along.
    inner = np.logical_and.reduce([np.roll(beyond, k, axis=1) for k in range(-6, 7)])
    changed = replace(log, ranges=np.where(inner, 0.7 * log.ranges, log.ranges))
    assert inner.any(axis=1).sum() >= 3
    pairs = scan_pairs(log, np.ones(len(POSES), dtype=bool), env, 1.0)
    scanner = scanner_of(log, None)
    one, two = (compared(scans, pairs, env, scanner, MODEL) for scans in (log, changed))
    np.testing.assert_allclose(two.known.alike, one.known.alike, rtol=1e-6)
    assert (np.abs(np.log(two.measured.alike / one.measured.alike)) > 0.1).any()
    assert (one.known.alike >= one.measured.alike * (1 - 1e-6)).all()
    assert (one.beams <= scanner.beams).all() and (one.beams[:2] < one.beams[-2:]).all()


def test_along_a_corridor_scans_agree_and_at_its_end_they_do_not():
    _, _, pairs, found = study(noise=0.01)
    figures = pose_figures(pairs, found.measured)
    # The sixth stands beside the other two: only along the corridor scans agree.
    assert figures["ambiguity"][3:5].min() > 50 * figures["ambiguity"][[0, 1, 2, 5]].max()
    assert figures["major"][3:5].min() > figures["major"][:3].max()


def test_figures_of_pairs_that_agree_fully_are_those_of_the_free_neighbourhood():
    _, _, pairs, found = study()
    ones = found.predicted
    c0 = ones.cell_variance
    ones.alike[:], ones.offset[:], ones.spread[:] = 1.0, 0.0, (c0, 0.0, c0)
    ones.own[:] = (1.0, 0.0, 0.0, c0, 0.0, c0)
    figures = pose_figures(pairs, ones)
    np.testing.assert_allclose(figures["level"], 1.0)
    np.testing.assert_allclose(figures["ambiguity"], 1.0)


def test_in_view_of_half_a_turn():
    seen = in_view(HALF_TURN, np.array([-1.5, 0.0, 1.5]), np.array([0.0, 0.5, -0.5, math.pi]))
    np.testing.assert_array_equal(
        seen, [[True, True, True], [False, True, True], [True, True, False], [False, False, False]]
    )
