"""Intensities in Monte Carlo localization: reflectors tell alike places apart."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.geometry.environment import Environment
from ambinav.localization.intensity import ODD, surface_fits
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.localization.range_table import reflectors_looked_up
from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, read_intensity
from tests.localization import worlds

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
MODELS = ("likelihood_field", "likelihood_field_prob", "beam", "beam_prob")
# Without a symmetry, and so that a scan tells the place at once.
ROOM = shapely.Polygon([(0, 0), (4, 0), (4.5, 1.5), (3, 3.5), (1, 3)])
APART = 8.0


def twins() -> Environment:
    """Two rooms that are alike but for a tag in the second."""
    twin = shapely.affinity.translate(ROOM, APART, 0.0)
    tag = [(APART + 1.0, 0.0), (APART + 2.5, 0.0)]
    return an.environment_from_shapes([ROOM, twin], reflectors=[tag])


def laser(reach: float = 6.0) -> RangeScanner:
    return worlds.laser(reach=reach).with_intensity(CHANNEL)


def parameters(model: str, **given: object) -> MclParameters:
    return MclParameters.from_dict(
        {
            "laser_model_type": model, "min_particles": 400, "max_particles": 400,
            "recovery_alpha_slow": 0.0, "recovery_alpha_fast": 0.0, **given,
        }
    )  # fmt: skip


def share_in_second(model: str, *, heard: bool, truth: float, **given: object) -> float:
    """Weight of the particles in the second room after scans in one of them, both as likely."""
    env, scanner = twins(), laser()
    rng = np.random.default_rng(4)
    filters = MonteCarloLocalizer(env, scanner, parameters(model, **given), rng=rng)
    pose = np.array([2.0 + truth, 1.5, 0.3])
    filters.start(pose, np.diag([0.01, 0.01, 0.001]))
    # Half of them in the same place of the other room.
    filters.state.particles[0, ::2, 0] += APART if truth == 0.0 else -APART
    for step in range(12):
        # Far enough for an update; the robot goes to and fro.
        at = pose + np.array([0.3 * (step % 2), 0.0, 0.0])
        ranges = scanner.read(env, *at, rng)
        intensities = read_intensity(scanner, env, *at, ranges, rng)
        beside = (intensities,) if heard else ()
        assert filters.update(at, ranges, *beside)[0]
    poses, weights = filters.particles()
    return float(weights[poses[:, 0] > 0.5 * APART + 2.0].sum() / weights.sum())


@pytest.mark.sweep
def test_a_table_of_ranges_knows_reflectors() -> None:
    """Nearly as rays do; so does the default of a robot with sonars beside its laser."""
    env, rng = twins(), np.random.default_rng(3)
    both = RangeScanner.mixed(worlds.sonar_ring(), worlds.laser(reach=6.0)).with_intensity(CHANNEL)
    given = MclParameters.for_scanner(both, max_beams=76)
    assert given.beam_table_resolution > 0.0
    found = MonteCarloLocalizer(env, both, given, rng=rng)
    assert found.channel is not None
    poses = np.column_stack([rng.uniform(9, 11.5, 200), rng.uniform(0.5, 2, 200), np.zeros(200)])
    inside = env.is_free(*poses[:, :2].T, 0.3)
    wrong = 0.0
    for pose in poses[inside]:
        met = np.empty(len(found.model.beam), dtype=np.bool_)
        reflectors_looked_up(*pose, found.model.table, met)
        # Of the laser, which follows the 16 sonars.
        angle = both.mounts[16:, 2] + pose[2]
        _, segment = env.cast_hits(pose[0], pose[1], angle, 6.0)
        truly = env.segments.reflectors[segment]
        assert truly.any()
        wrong += (met[16:] != truly).mean() / inside.sum()
    assert wrong < 0.02
    assert share_in_second("beam_prob", heard=True, truth=APART, beam_table_resolution=0.1) > 0.95


@pytest.mark.parametrize("model", MODELS)
def test_a_tag_tells_twin_rooms_apart(model: str) -> None:
    """With intensities all particles are in the right room, whichever has the tag."""
    assert share_in_second(model, heard=True, truth=APART) > 0.95
    assert share_in_second(model, heard=True, truth=0.0) < 0.05


def test_ranges_alone_do_not() -> None:
    """The same filter without intensities has no reason to choose."""
    kept = [
        share_in_second("likelihood_field", heard=False, truth=truth, resample_interval=100)
        for truth in (0.0, APART)
    ]
    assert all(0.2 < share < 0.8 for share in kept)


def test_the_factor_is_the_module_s() -> None:
    """Against scipy's normal densities; nothing is said where nothing was read, or too near."""
    from scipy.stats import norm

    env = twins()
    scanner = worlds.laser(beams=8).with_intensity(replace(CHANNEL, min_range=0.5))
    filters = MonteCarloLocalizer(env, scanner, parameters("beam"), rng=np.random.default_rng(0))
    assert filters.channel is not None
    assert filters.reads_intensities
    ranges = np.array([1.0, 1.0, 1.0, 1.0, 0.4, math.inf, -math.inf, math.nan], dtype=np.float32)
    read = np.array([0.3, 1.0, 0.65, math.nan, 1.0, 1.0, 1.0, 5.0], dtype=np.float32)
    fits = np.empty((8, 2))
    surface_fits(ranges, read, filters.model.beam, filters.channel, fits)
    assert (fits[3:] == 1.0).all()
    dark, light = norm.pdf(read[:3, None], [0.3, 1.0], 0.15).T
    share = light / (dark + light)
    assert np.allclose(fits[:3, 1], ODD + (1 - ODD) * share)
    assert np.allclose(fits[:3, 0], ODD + (1 - ODD) * (1 - share))


def test_weights_of_one_scan() -> None:
    """The ray model's weights, by the formula in NumPy: rays against segments, kind by kind."""
    env, scanner = twins(), laser()
    rng = np.random.default_rng(1)
    given = parameters("beam_prob", resample_interval=100, importance_factor=1.0)
    filters = MonteCarloLocalizer(env, scanner, given, rng=rng)
    pose = np.array([APART + 2.0, 1.5, 0.3])
    filters.start(pose, np.diag([0.02, 0.02, 0.01]))
    ranges = scanner.read(env, *pose, rng).ravel()
    read = read_intensity(scanner, env, *pose, ranges, rng).ravel()
    particles, before = filters.particles()
    filters.update(pose, ranges, read)
    _, after = filters.particles()
    expected = scanner.scan(env, *particles.T).astype(np.float64)
    yaw = particles[:, 2:] + scanner.mounts[:, 2]
    _, segment = env.cast_hits(particles[:, :1], particles[:, 1:2], yaw, 20.0)
    fits = np.empty((scanner.beams, 2))
    surface_fits(ranges, read, filters.model.beam, filters.channel, fits)
    met = np.where(env.segments.reflectors[segment], fits[:, 1], fits[:, 0])
    p, far = filters.parameters, 6.0
    z, least = np.minimum(ranges, far), np.minimum(expected, far)
    hit = np.exp(-((z - least) ** 2) / (2 * p.sigma_hit**2))
    short = p.z_short * p.lambda_short * np.exp(-p.lambda_short * z)
    like = p.z_hit * hit + np.where(z < least, short, 0.0)
    like += np.where(z >= far, p.z_max, p.z_rand / far)
    like *= hit * met + (1 - hit) * fits[:, 0]
    want = np.log(like).sum(axis=1)
    want = before * np.exp(want - want.max())
    inside = np.isfinite(expected).all(axis=1)
    assert inside.sum() > 300
    after, want = after[inside], want[inside]
    assert np.allclose(after / after.sum(), want / want.sum(), atol=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_without_a_channel_nothing_changes(model: str) -> None:
    """To the bit: reflectors without a channel, and a channel without intensities given."""
    env = twins()
    found = []
    for scanner in (worlds.laser(reach=6.0), laser()):
        rng = np.random.default_rng(2)
        filters = MonteCarloLocalizer(env, scanner, parameters(model), rng=rng)
        filters.start([2.0, 1.5, 0.3], np.diag([0.04, 0.04, 0.01]))
        for step in range(4):
            at = np.array([2.0 + 0.3 * (step % 2), 1.5, 0.3])
            filters.update(at, scanner.read(env, *at, rng))
        found.append(filters.mean)
    np.testing.assert_array_equal(*found)


def test_what_cannot_be_is_refused() -> None:
    """A shape that does not fit."""
    env, rng = twins(), np.random.default_rng(0)
    filters = MonteCarloLocalizer(env, laser(), parameters("likelihood_field"), rng=rng)
    filters.start([2.0, 1.5, 0.0], np.eye(3) * 0.01)
    with pytest.raises(InputError, match="intensities have the shape"):
        filters.update([2.0, 1.5, 0.0], np.ones(60), np.ones(59))
