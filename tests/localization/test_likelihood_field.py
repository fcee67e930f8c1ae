"""The likelihood field against shapely, and its likelihoods against AMCL's formulas in NumPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from ambinav.localization.likelihood_field import LikelihoodField, field_factors, hit_at
from ambinav.runtime.errors import InputError
from tests.geometry import scenes
from tests.localization import worlds


@pytest.mark.slow
def test_distances_are_exact() -> None:
    env = scenes.scene(2, size=12.0)
    field = LikelihoodField.of(env, 0.07, 1.3)
    lines = shapely.multilinestrings(env.segments.xy.reshape(-1, 2, 2))
    rows, columns = (v.ravel() for v in np.indices(field.distance.shape))
    x, y = (field.origin[i] + field.resolution * v for i, v in enumerate((columns, rows)))
    expected = np.minimum(shapely.distance(lines, shapely.points(x, y)), 1.3)
    assert np.abs(field.distance.ravel() - expected).max() < 1e-5


def test_the_lattice_reaches_beyond_what_matters() -> None:
    field = LikelihoodField.of(worlds.box(3.0, 2.0), 0.025, 1.0)
    rim = (field.distance[0], field.distance[-1], field.distance[:, 0], field.distance[:, -1])
    assert all(np.allclose(edge, 1.0, atol=1e-6) for edge in rim)


def test_frontiers_count_only_if_asked() -> None:
    env = worlds.box(6.0, 6.0, frontiers=(1,))
    at = (round((3.0 + 1.0) / 0.05), round((6.0 + 1.0) / 0.05))
    assert LikelihoodField.of(env, 0.05, 1.0).distance[at] == pytest.approx(1.0)
    with_them = LikelihoodField.of(env, 0.05, 1.0, frontiers=True)
    assert with_them.distance[at] == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(InputError, match="no walls"):
        LikelihoodField.of(worlds.box(6.0, 6.0, frontiers=(0, 1, 2, 3)))


@pytest.mark.parametrize("arguments", [(0.0, 2.0), (0.025, -1.0), (math.nan, 2.0), (1e-5, 2.0)])
def test_bad_numbers_are_refused(arguments: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=r"resolution|max_distance"):
        LikelihoodField.of(worlds.room(), *arguments)


def test_interpolation_is_linear_and_nothing_hits_off_the_lattice() -> None:
    hits = np.array([[0.0, 1.0], [2.0, 4.0]], dtype=np.float32)
    assert hit_at(0.5, 0.5, hits, True) == pytest.approx(1.75)
    assert hit_at(0.25, 0.0, hits, True) == pytest.approx(0.25)
    assert hit_at(0.6, 0.4, hits, False) == 1.0
    assert hit_at(-0.4, 1.4, hits, False) == 2.0
    for u, v in ((-0.6, 0.0), (0.0, 1.6), (math.nan, 0.0), (1e300, 0.0)):
        assert hit_at(u, v, hits, False) == hit_at(u, v, hits, True) == 0.0


def expected_factors(
    field: LikelihoodField, poses: np.ndarray, end: np.ndarray, far: np.ndarray, power: float
) -> tuple[np.ndarray, np.ndarray]:
    """AMCL's two likelihoods by NumPy: 1 + sum of cubes, and the product."""
    c, s = np.cos(poses[:, 2:]), np.sin(poses[:, 2:])
    x = poses[:, :1] + c * end[:, 0] - s * end[:, 1]
    y = poses[:, 1:2] + s * end[:, 0] + c * end[:, 1]
    column = np.floor((x - field.origin[0]) / field.resolution + 0.5).astype(int)
    row = np.floor((y - field.origin[1]) / field.resolution + 0.5).astype(int)
    rows, columns = field.distance.shape
    on = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
    d = np.where(on, field.distance[row.clip(0, rows - 1), column.clip(0, columns - 1)], np.inf)
    p = 0.5 * np.exp(-(d**2) / (2 * 0.2**2)) + 0.5 / far
    return 1.0 + (p**3).sum(axis=1), np.prod(p, axis=1) ** power


@pytest.mark.parametrize("log", [False, True])
def test_factors_are_amcls(log: bool) -> None:
    field = LikelihoodField.of(worlds.room())
    poses = worlds.free_poses(worlds.room(), 300, seed=1)
    rng = np.random.default_rng(2)
    end = rng.uniform(-6.0, 6.0, (40, 2))
    far = rng.uniform(3.0, 9.0, 40)
    particles = np.zeros((300, 5))
    particles[:, :3], particles[:, 3] = poses, rng.uniform(0.1, 1.0, 300)
    before = particles[:, 3].copy()
    scale = field_factors(
        particles, 300, end, 0.5 / far, 40, 0.5, field.hits(0.2), *field.origin,
        1.0 / field.resolution, False, log, 0.3, np.empty(300),
    )  # fmt: skip
    got = particles[:, 3] / before * math.exp(scale)
    assert np.allclose(got, expected_factors(field, poses, end, far, 0.3)[log], rtol=1e-4)


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("floor", [30.0, 0.05, 1e-30, 1e-200, 0.0])
def test_logarithms_of_products_are_sums_of_logarithms(floor: float, smooth: bool) -> None:
    """The filter takes one logarithm of many beams, whatever the product would come to."""
    field = LikelihoodField.of(worlds.room())
    hits = field.hits(0.2)
    rng = np.random.default_rng(3)
    beams = rng.uniform(-6.0, 6.0, (700, 2))
    particles = np.zeros((300, 5))
    particles[:, :3], particles[:, 3] = worlds.free_poses(worlds.room(), 300, seed=1), 1.0
    place = *field.origin, 1.0 / field.resolution

    def scale_of(end: np.ndarray, poses: np.ndarray) -> float:
        return field_factors(
            poses, 1, end, np.full(len(end), floor), len(end), 0.5, hits, *place, smooth, True,
            1.0, np.empty(1),
        )  # fmt: skip

    for one in particles[:5]:
        sums = sum(scale_of(beams[k : k + 1], one[None].copy()) for k in range(700))
        assert scale_of(beams, one[None].copy()) == pytest.approx(sums, rel=1e-12)
    if floor >= 1e-30:
        weights = particles.copy()
        field_factors(
            weights, 300, beams, np.full(700, floor), 700, 0.5, hits, *place, smooth, True, 0.01,
            np.empty(300),
        )  # fmt: skip
        assert np.isfinite(weights).all() and weights[:, 3].max() == 1.0


def test_many_beams_do_not_underflow() -> None:
    field = LikelihoodField.of(worlds.room())
    particles = np.array([[2.0, 2.0, 0.0, 0.5, 0.0], [2.0, 2.1, 0.0, 0.5, 0.0]])
    end = np.tile([[100.0, 0.0]], (2000, 1))
    end[:10] = (-2.0, 0.0)
    scale = field_factors(
        particles, 2, end, np.full(2000, 0.05), 2000, 0.5, field.hits(0.2), *field.origin,
        1.0 / field.resolution, True, True, 1.0, np.empty(2),
    )  # fmt: skip
    assert scale < -1000.0 and particles[:, 3].max() == 0.5 and np.isfinite(particles).all()
