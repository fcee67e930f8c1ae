"""A scan compared with itself displaced: against the map it was taken in."""

from __future__ import annotations

import numpy as np
import pytest
from real_scans.compared import SPACING, evidence_of
from real_scans.displaced_scan import displaced_figures
from real_scans.log_split import as_seen_from_laser, scanner_of

from ambinav.ambiguity import reference
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.tensor import relative_radii
from tests.real_scans.rooms import environment, log_of

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

MODEL = AmbiguityModel(radius=0.5, map_std=0.05, tau=4.0)
STEPS = np.array([(y, x) for y in range(-5, 6) for x in range(-5, 6) if np.hypot(x, y) <= 5])


def figures(poses, noise=0.0, max_range=4.0, free=None):
    env = environment()
    log = as_seen_from_laser(log_of(env, poses, noise=noise))
    scanner = scanner_of(log, max_range)
    table = BeamTable.of(scanner, MODEL.map_std, MODEL.outlier_share)
    found = displaced_figures(
        log.ranges, log.angles, log.poses[:, 2].copy(), STEPS, SPACING,
        np.ones((len(poses), len(STEPS)), dtype=bool) if free is None else free,
        scanner.mounts[:, 2].copy(), table, evidence_of(table), MODEL.tau,
        (SPACING**2 / 4, MODEL.sigma_theta**2),
    )  # fmt: skip
    return found, env, scanner


@pytest.mark.slow(kept=("pose1",))
@pytest.mark.parametrize("pose", [(6.0, 1.0, 0.0), (6.0, 1.1, 1.2), (20.5, 1.0, 0.2)])
def test_scan_and_map_say_the_same(pose):
    found, env, scanner = figures(np.array([pose]))
    expected = relative_radii(reference.pose_sums(env, scanner, MODEL, SPACING, *pose))
    for name in ("major", "minor", "level"):
        assert found[name][0] == pytest.approx(float(expected[name]), abs=0.06), name


def test_the_corridor_is_weak_along_itself_whatever_the_heading():
    poses = np.array([(8.0, 1.0, t) for t in (0.0, 0.4, np.pi, -2.9)])
    found, _, _ = figures(poses, noise=0.005)
    assert (found["major"] > 0.9).all()
    assert (found["minor"] < 0.35).all()
    off = (found["direction"] + np.pi / 2) % np.pi - np.pi / 2
    assert np.abs(off).max() < 0.05


def test_a_scan_that_saw_nothing_tells_nothing():
    env = environment()
    log = as_seen_from_laser(log_of(env, np.array([(8.0, 1.0, 0.0)])))
    log.ranges[:] = np.inf
    scanner = scanner_of(log, 4.0)
    table = BeamTable.of(scanner, 0.05, 0.05)
    found = displaced_figures(
        log.ranges, log.angles, log.poses[:, 2].copy(), STEPS, SPACING,
        np.ones((1, len(STEPS)), dtype=bool), scanner.mounts[:, 2].copy(), table, None, 4.0,
        (SPACING**2 / 4, 0.0025),
    )  # fmt: skip
    np.testing.assert_allclose(found["level"], 1.0, atol=1e-5)


def test_only_the_free_neighbourhood_counts():
    free = (STEPS[:, 1] == 0)[None]
    found, _, _ = figures(np.array([(8.0, 1.0, 0.0)]), free=free)
    everything, _, _ = figures(np.array([(8.0, 1.0, 0.0)]))
    # Without the neighbours along the corridor nothing shows that the robot can slide there.
    assert found["major_radius"][0] < 0.3 * everything["major_radius"][0]
