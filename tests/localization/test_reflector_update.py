"""Matching of reflectors, and the update by them against the textbook."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, seen_reflectors
from ambinav.localization.reflector_detection import BEARING, RANGE, SIZE
from ambinav.localization.reflector_update import update_by_reflectors
from ambinav.localization.reflector_view import SLOPE
from ambinav.sensing import RangeScanner, read_intensity
from tests.localization.reflector_scenes import (
    ArrayF,
    Floats,
    detected,
    exact,
    hall,
    known,
    laser,
    view_of,
)

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow


def one_update(
    environment: Environment, scanner: RangeScanner, pose: Floats, prior: Floats, cov: Floats,
    place: float = 0.0, scan: tuple[ArrayF, ArrayF] | None = None,
) -> tuple[Floats, Floats, int]:  # fmt: skip
    """Return estimate, covariance and number of reflectors after a scan without noise."""
    reflectors = known(environment, scanner, place)
    ranges, read = exact(environment, scanner, pose) if scan is None else scan
    mean, after, used = prior[None].copy(), cov[None].copy(), np.empty(1, dtype=np.int64)
    rules = ReflectorRules()
    seen = seen_reflectors(environment, scanner, Targets.of(environment), mean, rules)
    update_by_reflectors(mean, after, ranges[None], read[None], seen, reflectors, used)
    return mean[0], after[0], int(used[0])


PRIOR = np.array([[0.04, 0.01, 0.002], [0.01, 0.03, -0.001], [0.002, -0.001, 0.001]]) / 4


def test_one_post_is_the_update_of_the_textbook() -> None:
    """The gain K = P H' (H P H' + R)^-1 (Probabilistic Robotics, table 7.2), by differences."""
    environment, scanner = hall((8.0, 7.0)), laser(mount=(0.2, 0.1, 0.5))
    truth = np.array([12.0, 5.0, 2.0])
    before = truth + np.array((0.05, -0.04, 0.01))
    mean, cov, used = one_update(environment, scanner, truth, before, PRIOR, place=0.0004)
    assert used == 1

    def reading(pose: Floats) -> Floats:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx = 8.0 - pose[0] - (0.2 * c - 0.1 * s)
        dy = 7.0 - pose[1] - (0.2 * s + 0.1 * c)
        return np.array([math.atan2(dy, dx) - pose[2], math.hypot(dx, dy)])

    scan = exact(environment, scanner, truth)
    (row,) = detected(scanner, *scan)
    depth = math.pi / 4 * 0.05
    off = np.array([row[BEARING], row[RANGE] + depth]) - reading(before)
    H = np.array([reading(before + e) - reading(before - e) for e in 1e-6 * np.eye(3)]).T / 2e-6
    far = reading(before)[1] - depth
    # Depths of a disc of radius r have the variance (2 / 3 - pi^2 / 16) r^2.
    shape = (2 / 3 - math.pi**2 / 16) * 0.05**2
    R = np.diag(
        [(math.pi / 360) ** 2 / 12 + 0.0004 / far**2,
         (0.01**2 + 0.001**2 / 12 + shape) / row[SIZE] + 0.0004]
    )  # fmt: skip
    K = PRIOR @ H.T @ np.linalg.inv(H @ PRIOR @ H.T + R)
    assert np.allclose(mean, before + K @ off, atol=3e-4)
    assert np.allclose(cov, PRIOR - K @ H @ PRIOR, atol=2e-5)


def test_on_a_slanted_strip_bearing_and_range_err_together() -> None:
    """Seen at 40 degrees: that noise in scans drawn at random, and in the update's covariance."""
    environment, scanner = hall(strips=(14.0,)), laser(beams=1440)
    reflectors, rng, step = known(environment, scanner), np.random.default_rng(4), math.pi / 720

    def reading(pose: Floats) -> Floats:
        low, high = (math.atan2(-pose[1], x - pose[0]) for x in (13.85, 14.15))
        angle = np.linspace(low, high, 2001)
        return np.array([0.5 * (low + high) - pose[2], (-pose[1] / np.sin(angle)).mean()])

    errors = []
    for shift, theta in rng.uniform((0.0, -3.0), (0.3, 3.0), (600, 2)):
        pose = np.array([10.0 + shift, 4.8, theta])
        rows = detected(scanner, *exact(environment, scanner, pose))
        (row,) = rows[np.abs(rows[:, RANGE] - reading(pose)[1]) < 0.3]
        off = row[[BEARING, RANGE]] - reading(pose)
        errors.append((math.remainder(off[0], 2 * math.pi), off[1]))
    off, away = np.array(errors).T
    view = view_of(reflectors, np.array([10.15, 4.8, 0.0]), PRIOR)
    assert view is not None
    assert np.polyfit(off, away, 1)[0] == pytest.approx(view[SLOPE], rel=0.05)
    truth = np.array([10.15, 4.8, 0.5])
    _, cov, used = one_update(environment, scanner, truth, truth, PRIOR)
    rows = detected(scanner, *exact(environment, scanner, truth))
    H = np.array([reading(truth + e) - reading(truth - e) for e in 1e-6 * np.eye(3)]).T / 2e-6
    comb = step * step / 12
    own = (0.01**2 + 0.001**2 / 12) / rows[0, SIZE]
    R = np.array([[comb, view[SLOPE] * comb], [view[SLOPE] * comb, view[SLOPE] ** 2 * comb + own]])
    information = H.T @ np.linalg.solve(R, H)
    gained = np.linalg.inv(cov) - np.linalg.inv(PRIOR)
    assert used == 1
    assert np.allclose(gained, information, atol=0.02 * np.abs(information).max())


def test_three_in_view_fix_the_pose() -> None:
    environment = hall((4.0, 4.0), (15.0, 8.0), (12.0, 2.0))
    truth = np.array([9.0, 6.0, 0.3])
    mean, cov, used = one_update(
        environment, laser(1440), truth, truth + np.array((0.1, -0.1, 0.03)), PRIOR
    )
    assert used == 3
    assert np.hypot(*(mean - truth)[:2]) < 0.02
    assert math.sqrt(cov[0, 0] + cov[1, 1]) < 0.02
    assert np.linalg.eigvalsh(cov).min() > 0.0


def test_what_is_no_reflector_of_the_map_is_left_out() -> None:
    """A vest beside the path, a surface wider than the post, and a post behind a wall."""
    environment, scanner = hall((8.0, 7.0)), laser()
    truth = np.array([12.0, 5.0, 2.0])
    ranges, read = exact(environment, scanner, truth)
    bright = np.flatnonzero(read > 0.7)
    vest = read.copy()
    vest[bright], vest[bright - 90] = 0.3, 1.0
    wide = read.copy()
    wide[bright[0] - 6 : bright[-1] + 7] = 1.0
    flat = ranges.copy()
    flat[bright[0] - 6 : bright[-1] + 7] = ranges[bright].mean()
    for scan in ((ranges, vest), (flat, wide)):
        mean, cov, used = one_update(environment, scanner, truth, truth, PRIOR, scan=scan)
        assert used == 0
        assert np.array_equal(mean, truth)
        assert np.array_equal(cov, PRIOR)
    walled = environment.edited(add=[Obstacle.wall([(9.0, 4.0), (11.0, 9.0)])])
    assert one_update(walled, scanner, truth, truth, PRIOR, scan=(ranges, read))[2] == 0


def test_what_may_be_two_is_used_once_others_tell() -> None:
    """Posts 0.3 m apart and a pose known to 0.3 m: alone neither is used, beside a third both."""
    pair, third = ((8.0, 7.0), (8.0, 7.3)), (16.0, 9.0)
    truth, wide = np.array([12.0, 5.0, 2.0]), np.diag([0.09, 0.09, 0.01])
    prior = truth + np.array((0.1, 0.15, 0.02))
    scanner = laser(1440)
    mean, _, used = one_update(hall(*pair), scanner, truth, prior, wide)
    assert used == 0
    assert np.array_equal(mean, prior)
    mean, _, used = one_update(hall(*pair, third, (12.0, 10.0)), scanner, truth, prior, wide)
    assert used == 4
    assert np.hypot(*(mean - truth)[:2]) < 0.03


def test_a_single_bright_beam_is_not_a_wide_strip() -> None:
    """A wall reads as bright in one of 400 beams; the strip, of 23 beams, is dark here."""
    environment, scanner = hall(strips=(10.0,)), laser(beams=1440)
    truth = np.array([10.0, 3.0, 0.4])
    ranges, read = exact(environment, scanner, truth)
    bright = np.flatnonzero(read > 0.7)
    for kept, expected in ((bright, 1), (bright[: len(bright) // 2], 1), (bright[:1], 0)):
        dark = np.full_like(read, 0.3)
        dark[kept] = 1.0
        scan = ranges, dark
        assert one_update(environment, scanner, truth, truth, PRIOR, scan=scan)[2] == expected


def test_a_half_hidden_strip_widens_the_bearing() -> None:
    """The estimate stays within what the covariance says, at 40 poses behind a screen."""
    environment = hall(strips=(10.0,)).edited(add=[Obstacle.wall([(9.0, 0.5), (9.99, 0.5)])])
    scanner, in_sight = laser(1440), hall(strips=(10.0,))
    squares = []
    for y in np.linspace(2.0, 5.0, 40):
        truth = np.array([10.0, y, 0.4])
        mean, cov, used = one_update(environment, scanner, truth, truth, PRIOR)
        _, free, _ = one_update(in_sight, scanner, truth, truth, PRIOR)
        assert used == 1
        assert np.linalg.det(cov) > 4.0 * np.linalg.det(free)
        error = mean - truth
        squares.append(error @ np.linalg.solve(cov, error))
    assert max(squares) < 3.0


def test_a_strip_at_grazing_incidence_keeps_to_its_covariance() -> None:
    """At 70 degrees, with the rule for incidence off: bearing and range err together."""
    environment, scanner = hall(strips=(14.0,)), laser(1440)
    reflectors, rng = known(environment, scanner), np.random.default_rng(8)
    cov = np.diag([0.05, 0.05, 0.02]) ** 2
    squares = []
    for shift in rng.uniform(0.0, 0.5, 200):
        truth = np.array([14.0 - 8.0 * math.tan(math.radians(70)) * 0.3 - shift, 2.4, 0.0])
        ranges = scanner.read(environment, *truth, rng)
        read = read_intensity(scanner, environment, *truth, ranges, rng)
        mean = (truth + rng.normal(size=3) * np.sqrt(np.diag(cov)))[None]
        after, used = cov[None].copy(), np.empty(1, dtype=np.int64)
        update_by_reflectors(
            mean, after, ranges[None], read[None], np.ones((1, 1), bool), reflectors, used
        )
        if used[0]:
            error = mean[0] - truth
            squares.append(error @ np.linalg.solve(after[0], error))
    assert len(squares) > 180
    assert 2.4 < np.mean(squares) < 3.6
