"""The directions of reflectors in the Kalman filter: right, consistent, and of no effect else."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.tag_bearings import SURE, tag_model, take_in_tags
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, RangeSensor, read_intensity

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
ENV = an.environment_from_shapes(
    [shapely.box(0, 0, 40, 2.4)],
    reflectors=[[(19.8, 0.0), (20.2, 0.0)], shapely.Point(22.0, 2.0).buffer(0.05, 8)],
)
SENSOR = RangeSensor(max_range=8.0, std=0.02, resolution=0.001, random_share=0.0)
SCANNER = RangeScanner.planar(SENSOR, 360, 2 * math.pi).with_intensity(CHANNEL)
PRIOR = np.diag([0.3**2, 0.05**2, 0.02**2])


def estimates(scanner: RangeScanner, *, heard: bool) -> tuple[np.ndarray, np.ndarray]:
    """Errors (R, 3) and covariances (R, 3, 3) after one scan of 400 robots beside the tag."""
    rng = np.random.default_rng(6)
    truth = np.column_stack([rng.uniform(18, 19.5, 400), rng.uniform(1, 1.5, 400), np.zeros(400)])
    runs = ExtendedKalmanFilter(ENV, scanner, runs=400)
    runs.start(truth + rng.normal(size=(400, 3)) * np.sqrt(np.diag(PRIOR)), PRIOR)
    ranges = scanner.read(ENV, *truth.T, rng)
    beside = (read_intensity(scanner, ENV, *truth.T, ranges, rng),) if heard else ()
    runs.update(np.zeros((400, 3)), ranges, *beside)
    error = runs.mean - truth
    error[:, 2] = (error[:, 2] + math.pi) % (2 * math.pi) - math.pi
    return error, runs.covariance


def test_what_the_model_holds() -> None:
    """Both reflectors, their corners, and an intensity from which it is surely one of them."""
    tags = tag_model(ENV, SCANNER, 0.03)
    assert tags is not None
    assert len(tags.first) == 3
    sizes = sorted(np.diff(tags.first).tolist())
    # A line has two ends, a ring of 32 edges comes back to its first corner.
    assert sizes == [2, 33]
    dark, light = (math.exp(-0.5 * ((tags.bright[0] - m) / 0.15) ** 2) for m in (0.3, 1.0))
    assert light / (dark + light) == pytest.approx(SURE)
    assert math.sqrt(tags.turn) == pytest.approx(math.radians(1.0) / math.sqrt(12))
    bare = an.environment_from_shapes([shapely.box(0, 0, 4, 4)])
    assert tag_model(bare, SCANNER, 0.03) is None
    assert tag_model(ENV, RangeScanner.planar(SENSOR, 360, 2 * math.pi), 0.03) is None


def test_reflectors_tell_the_place_along_the_corridor() -> None:
    """The error falls, and is what the filter says; ranges see the post too, but not the tag."""
    blind, blind_cov = estimates(SCANNER, heard=False)
    error, cov = estimates(SCANNER, heard=True)
    assert np.sqrt((error[:, 0] ** 2).mean()) < 0.25 * np.sqrt((blind[:, 0] ** 2).mean())
    assert np.median(cov[:, 0, 0]) < 0.7 * np.median(blind_cov[:, 0, 0])
    assert np.linalg.eigvalsh(cov).min() > 0.0
    ratio = error[:, 0] ** 2 / cov[:, 0, 0]
    assert 0.5 < np.median(ratio) / 0.455 < 2.0
    # What the tag says of the rest is little.
    assert np.sqrt((error[:, 1] ** 2).mean()) < 0.02


def test_one_reading_is_the_update_of_the_textbook() -> None:
    """One direction of one tag, by finite differences and the gain of a linear filter."""
    env = an.environment_from_shapes(
        [shapely.box(0, 0, 40, 2.4)], reflectors=[[(19.8, 0.0), (20.2, 0.0)]]
    )
    ahead = RangeScanner.planar(SENSOR, 90, math.pi).with_intensity(Intensity(0.3, 1.0, 0.01))
    tags = tag_model(env, ahead, 0.03)
    assert tags is not None
    truth, prior = np.array([18.5, 1.2, -0.4]), PRIOR / 4 + 0.0005 * np.ones((3, 3))
    ranges = ahead.scan(env, *truth)
    read = read_intensity(ahead, env, *truth, ranges, np.random.default_rng(1))
    before = truth + np.array([0.1, 0.0, 0.01])
    mean, cov = before.copy(), prior.copy()
    assert take_in_tags(mean, cov, ranges, read, 3.0, tags) == 1

    def direction(pose: np.ndarray) -> float:
        ends = np.array([[19.8, 0.0], [20.2, 0.0]]) - pose[:2]
        return float(np.arctan2(ends[:, 1], ends[:, 0]).mean() - pose[2])

    bright = ahead.mounts[read > 0.7, 2]
    assert len(bright) >= 3
    nudge = 1e-6 * np.eye(3)
    slope = np.array([(direction(before + e) - direction(before - e)) / 2e-6 for e in nudge])
    noise = tags.turn + tags.place / np.square([19.8 - before[0], before[1]]).sum()
    gain = prior @ slope / (slope @ prior @ slope + noise)
    assert np.allclose(mean, before + gain * (bright.mean() - direction(before)), atol=1e-6)
    assert np.allclose(cov, prior - np.outer(gain, slope @ prior), atol=1e-9)


def test_what_is_bright_elsewhere_is_left_out() -> None:
    """A reflective vest far from the tag, and a wall that dazzles all around."""
    truth = np.array([18.5, 1.2, 0.0])
    ranges = SCANNER.scan(ENV, *truth)
    for where in (SCANNER.mounts[:, 2] > 2.5, SCANNER.mounts[:, 2] < -2.5):
        read = np.where(where, 1.0, 0.3)
        found = []
        for beside in ((), (read,)):
            run = ExtendedKalmanFilter(ENV, SCANNER)
            run.start(truth, np.diag([0.05, 0.02, 0.01]) ** 2)
            run.update(np.zeros(3), ranges, *beside)
            found.append(run.mean)
        np.testing.assert_array_equal(*found)


def test_shapes_are_checked() -> None:
    run = ExtendedKalmanFilter(ENV, SCANNER)
    run.start([18.5, 1.2, 0.0], PRIOR)
    with pytest.raises(InputError, match="intensities have the shape"):
        run.update(np.zeros(3), np.ones(360), np.ones(3))


def test_without_intensities_nothing_changes() -> None:
    """To the bit, whether or not the scanner has the channel."""
    plain = RangeScanner.planar(SENSOR, 360, 2 * math.pi)
    found = [estimates(scanner, heard=False) for scanner in (SCANNER, plain)]
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
