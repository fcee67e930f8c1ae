"""Expected entropy: sampled scans, closed forms in a corridor and a hall, symmetries."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import norm, qmc, spearmanr

from ambinav.ambiguity.feasible_poses import standing_lattice
from ambinav.ambiguity.model import AmbiguityModel, independent_tau
from ambinav.ambiguity.reference import reachable
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.segments import FRONTIER
from ambinav.layers import bands as banding
from ambinav.layers.coastal_entropy import coastal_entropy, expected_evidence
from ambinav.layers.context import LayerContext
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.geometry import scenes
from tests.layers import brute_rays, oracle_cases

Floats = NDArray[np.float64]

LASER = RangeScanner.planar(RangeSensor(max_range=4.0, std=0.03, resolution=0.001), 60, 2 * math.pi)
MANY = RangeScanner.planar(RangeSensor(max_range=4.0, std=0.05, resolution=0.001), 60, 2 * math.pi)


def context_of(env: Environment, scanner: RangeScanner = LASER, **options: float) -> LayerContext:
    return LayerContext.of(build_map(env, scanner, **options), env)  # type: ignore[arg-type]


def oracle_cells(
    env: Environment, mounts: Floats, heading: float, x: float, y: float, h: float, radius: float
) -> Floats:
    """Offsets of the cells of the disc that free steps lead to, shape (N, 2), metres."""

    def stands(px: float, py: float) -> bool:
        return bool(
            oracle_cases.standing_poses(
                env, mounts, np.array([px]), np.array([py]), np.array([heading])
            )
        )

    def parted(px: float, py: float, dx: float, dy: float) -> bool:
        angle, length = math.atan2(dy, dx), math.hypot(dx, dy)
        found, _ = brute_rays.cast(env.segments.xy, px, py, angle, length)  # type: ignore[arg-type]
        return bool(found < length)

    found, todo = {(0, 0)}, [(0, 0)]
    while todo:
        i, j = todo.pop()
        for di, dj in itertools.product((-1, 0, 1), repeat=2):
            to = (i + di, j + dj)
            if to in found or math.hypot(*to) * h > radius * (1 + 1e-9):
                continue
            if stands(x + to[0] * h, y + to[1] * h) and not parted(
                x + i * h, y + j * h, di * h, dj * h
            ):
                found.add(to)
                todo.append(to)
    return h * np.array(sorted(found), dtype=np.float64)


def sampled(
    env: Environment,
    scanner: RangeScanner,
    model: AmbiguityModel,
    h: float,
    pose: tuple[float, float, float],
    rng: np.random.Generator,
    *,
    people: float = 0.0,
    poses: int = 256,
    scans: int = 120,
) -> float:
    """Expected entropy in bits by the definition: scans, poses and people drawn at random.

    A beam is odd with the share of the model and of the sensor, and then reads anything in its
    range; a reading is as likely as the mixture of both densities says. As many neighbouring beams
    as tau says err together.
    """
    x, y, heading = pose
    sensor, mounts, xy = scanner.sensors[0], scanner.mounts, env.segments.xy
    std = math.sqrt(sensor.std_at(0.0) ** 2 + sensor.resolution**2 / 12 + model.map_std**2)
    limit, beams = sensor.max_range, len(mounts)
    odd = model.outlier_share + sensor.random_share + sensor.lost_share
    anywhere = 1.0 / (limit - sensor.min_range)

    def ranges(px: Floats, py: Floats, theta: Floats) -> Floats:
        c, s = np.cos(theta)[..., None], np.sin(theta)[..., None]
        mx, my, yaw = mounts.T
        found, which, _ = brute_rays.cone(
            xy, px[..., None] + c * mx - s * my, py[..., None] + s * mx + c * my,
            theta[..., None] + yaw, sensor.aperture, limit, sensor.max_incidence or math.inf,
        )  # fmt: skip
        # Beams that end in unknown space tell nothing.
        unknown = (which >= 0) & (env.segments.kind[which] == FRONTIER)
        return np.where(unknown, np.nan, np.clip(found, sensor.min_range, limit))

    cells = oracle_cells(env, mounts, heading, x, y, h, model.radius)
    # Poses anywhere in each cell, well spread.
    drawn = qmc.Sobol(3, seed=rng).random(poses)
    px = x + cells[:, None, 0] + h * (drawn[:, 0] - 0.5)
    py = y + cells[:, None, 1] + h * (drawn[:, 1] - 0.5)
    theta = np.broadcast_to(heading + model.sigma_theta * norm.ppf(drawn[:, 2]), px.shape)
    there = ranges(px, py, theta)
    stands = oracle_cases.standing_poses(
        env, mounts, px.ravel(), py.ravel(), theta.ravel()
    ).reshape(px.shape)
    here = ranges(*(np.array([v]) for v in pose))[0]

    def together(values: Floats) -> Floats:
        return np.repeat(values, round(model.tau))[:beams]

    found = []
    for _ in range(scans):
        reads = np.minimum(here + together(rng.normal(0.0, std, beams)), limit)
        reads = np.where(here >= limit, limit, reads)
        is_odd = together(rng.random(beams)) < odd
        reads = np.where(is_odd, together(rng.uniform(sensor.min_range, limit, beams)), reads)
        reads = np.where(np.isnan(here), np.nan, reads)
        seen = rng.random(beams) < np.exp(-people * np.where(np.isnan(here), 0.0, here))
        density = (1.0 - odd) * norm.pdf(reads, there, std) + odd * anywhere
        evidence = -np.log(np.where(np.isnan(density), 1.0, density))
        likely = np.exp(-(evidence * seen).sum(axis=-1) / model.tau)
        b = np.where(stands, likely, 0.0).sum(axis=1) / stands.sum(axis=1)
        b = b[b > 0.0] / b.sum()
        found.append(-(b * np.log2(b)).sum())
    return float(np.mean(found))


@pytest.mark.sweep
@pytest.mark.parametrize("people", [0.0, 0.1])
@pytest.mark.parametrize(
    ("env", "x", "y", "off"),
    [
        (scenes.room(3.0, 2.4), 1.25, 1.05, 0.1),
        # In a corner scans are not linear over a quarter of a cell.
        (scenes.room(3.0, 2.4), 0.25, 0.35, 0.35),
        (scenes.room(12.0, 2.0), 6.05, 0.75, 0.1),
        # With few beams it matters which of them people block.
        (scenes.room(12.0, 12.0), 3.55, 6.05, 0.2),
        (scenes.room(5.0, 4.0, np.array([2.0, 0.0, 2.5, 2.2])), 2.75, 2.35, 0.1),
    ],
    ids=["room", "corner", "corridor", "wall", "edge"],
)
def test_is_what_sampled_scans_leave(
    env: Environment, x: float, y: float, off: float, people: float
) -> None:
    context = context_of(env, MANY, radius=0.3)
    layer = coastal_entropy(context, people=people)["coastal_entropy"]
    i = np.abs(context.lattice.y - y).argmin(), np.abs(context.lattice.x - x).argmin()
    rng = np.random.default_rng(5)
    expected = sampled(
        env, MANY, context.model, context.spacing, (x, y, 0.0), rng, people=people, poses=512
    )
    print(f"{layer[i]:.2f} {expected:.2f}")
    assert float(layer[i]) == pytest.approx(expected, abs=off)


def patches(
    env: Environment, scanner: RangeScanner, seed: int, count: int
) -> tuple[LayerContext, Floats]:
    """A lattice of 0.1 m about some places of a building, and these: x, y, heading, (N, 3)."""
    lattice = Lattice.over(env, 0.1)
    x, y = lattice.points
    rng = np.random.default_rng(seed)
    headings = np.zeros(1) if scanner.looks_all_around else np.array([0.0, 1.0])
    whole, _ = standing_lattice(lattice, scanner, headings)
    x, y = whole.points
    at = rng.permutation(len(x))[:count]
    near, _ = cKDTree(np.column_stack([x[at], y[at]])).query(np.column_stack([x, y]))
    model = AmbiguityModel(radius=0.3, map_std=0.03, tau=independent_tau(scanner))
    context = LayerContext(
        env, scanner, whole.among(near < 0.5), headings, not scanner.looks_all_around, model
    )
    poses = [(x[p], y[p], headings[k % len(headings)]) for k, p in enumerate(at)]
    return context, np.array(poses)


@pytest.mark.slow(kept=("scanner0-drawn",))
@pytest.mark.parametrize("which", oracle_cases.BUILDINGS)
@pytest.mark.parametrize("scanner", [oracle_cases.laser(24), oracle_cases.sonars()])
def test_against_brute_force(
    which: str, scanner: RangeScanner, request: pytest.FixtureRequest
) -> None:
    env = oracle_cases.building(which, request)
    context, poses = patches(env, scanner, 4, 12)
    layer = coastal_entropy(context, people=0.0)["coastal_entropy"]
    layer = layer if layer.ndim == 3 else layer[..., None]
    rng = np.random.default_rng(2)
    found = []
    for x, y, heading in poses:
        row = np.abs(context.lattice.y - y).argmin()
        column = np.abs(context.lattice.x - x).argmin()
        value = layer[row, column, np.abs(context.headings - heading).argmin()]
        if not np.isnan(value):  # nan: a pose of the other heading, with a sensor in a wall
            expected = sampled(
                env, scanner, context.model, 0.1, (x, y, heading), rng, poses=64, scans=60
            )
            found.append((float(value), expected))
    entropy, expected = np.array(found).T
    off, rank = np.abs(entropy - expected), spearmanr(entropy, expected).statistic
    print(f"{which} {scanner.name}: n {len(entropy)}, off by {np.median(off):.2f} at the median")
    print(
        f"{off.max():.2f} at most, {np.mean(entropy - expected):.2f} in the mean, rank {rank:.2f}"
    )
    assert np.median(off) < 0.25
    assert off.max() < 1.5  # beside the roughest walls sonars lose their echo within a quarter
    assert abs(np.mean(entropy - expected)) < 0.5
    assert rank > 0.65


def enumerated(context: LayerContext, x: float, y: float, rng: np.random.Generator) -> float:
    """Expected entropy in bits, by every scan that a scanner of wide bins can return."""
    h, sensor = context.spacing, context.scanner.sensors[0]
    cells = sorted(reachable(context.environment, x, y, h, context.radius))
    place = rng.uniform(-h / 2, h / 2, (len(cells), 30, 2)) + h * np.array(cells)[:, None]
    theta = rng.normal(0.0, context.model.sigma_theta, (len(cells), 30))
    there = context.scanner.scan(context.environment, x + place[..., 0], y + place[..., 1], theta)
    likely = np.moveaxis(sensor.reading_probabilities(there), (2, 3), (0, 1)).copy()
    # Beams, readings, cells, poses. The robot stands anywhere in its cell, so its ranges lie
    # anywhere in their bins; readings that it has next to never are left out.
    mine = likely[:, :, cells.index((0, 0))]
    total, weight = 0.0, 0.0
    for scan in itertools.product(*(np.flatnonzero(one.mean(axis=1) > 1e-3) for one in mine)):
        all_beams = np.prod([likely[b, k] for b, k in enumerate(scan)], axis=0).mean(axis=1)
        b = all_beams[all_beams > 0.0] / all_beams.sum()
        share = all_beams[cells.index((0, 0))]
        total -= share * (b * np.log2(b)).sum()
        weight += share
    assert weight > 0.98
    return float(total / weight)


@pytest.mark.slow
def test_wide_bins_leave_what_enumeration_says() -> None:
    sensor = RangeSensor(max_range=4.0, std=0.05, resolution=0.4)
    scanner = RangeScanner.planar(sensor, 4, 2 * math.pi)
    context = context_of(
        scenes.room(3.13, 2.37), scanner, radius=0.3, tau=1.0, map_std=0.0, outlier_share=1e-6,
        headings=1,
    )  # fmt: skip
    layer = coastal_entropy(context, people=0.0)["coastal_entropy"][context.free][:, 0]
    rng = np.random.default_rng(3)
    x, y = context.points
    inner = np.flatnonzero((np.abs(x - 1.56) < 1.1) & (np.abs(y - 1.18) < 0.7))
    chosen = rng.choice(inner, 5, replace=False)
    expected = [enumerated(context, x[p], y[p], rng) for p in chosen]
    # The layer averages over where ranges lie in their bins, so it is right in the mean.
    assert layer[chosen].mean() == pytest.approx(float(np.mean(expected)), abs=0.5)


@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0.0, 45.0])
def test_corridor_leaves_the_cells_along_it(degrees: float) -> None:
    angle = math.radians(degrees)
    context = context_of(scenes.room(16.0, 2.0).transformed(angle))
    found = coastal_entropy(context, people=0.0)
    x, y = context.points
    along = math.cos(angle) * x + math.sin(angle) * y
    across = -math.sin(angle) * x + math.cos(angle) * y
    middle = (np.abs(along - 8.0) < 1.0) & (np.abs(across - 1.0) < 0.3)
    bits = found["coastal_entropy"][context.free][middle]
    # One cell in 0.1 m along an axis of the lattice, within 0.5 m to either side; on the diagonal
    # the line meets one in 0.14 m, less or more of the next rows.
    expected = math.log2(11.0) if degrees == 0.0 else math.log2(2 * 0.5 / (0.1 * math.sqrt(2)))
    assert bits.min() > expected - 0.05
    assert bits.max() < expected + (0.1 if degrees == 0.0 else 0.8)


@pytest.mark.slow
def test_where_nothing_is_in_range_every_cell_is_as_probable() -> None:
    context = context_of(scenes.room(14.0, 14.0))
    found = coastal_entropy(context)
    x, y = context.points
    middle = np.hypot(x - 7.0, y - 7.0) < 1.0
    cells = len(reachable(context.environment, 7.05, 7.05, 0.1, 0.5))
    assert found["coastal_entropy"][context.free][middle] == pytest.approx(math.log2(cells), 1e-6)
    assert found["coastal_entropy_gain"][context.free][middle] == pytest.approx(0.0, abs=1e-5)


def test_a_crowd_of_no_end_leaves_nothing_to_see() -> None:
    context = context_of(scenes.room(3.0, 2.0))
    found = coastal_entropy(context, people=1000.0)
    assert np.nanmax(found["coastal_entropy_gain"]) < 0.01


@pytest.mark.slow
@settings(max_examples=10, deadline=None)
@given(width=st.floats(0.8, 6.0), depth=st.floats(0.8, 6.0), people=st.floats(0.0, 0.5))
def test_bounds_and_what_people_take(width: float, depth: float, people: float) -> None:
    context = context_of(scenes.room(width, depth), radius=0.3)
    quiet, busy = coastal_entropy(context, people=0.0), coastal_entropy(context, people=people)
    for found in (quiet, busy):
        for values in found.values():
            assert (np.isnan(values) == ~context.free).all()
            assert np.nanmin(values) >= 0.0
    before = quiet["coastal_entropy"] + quiet["coastal_entropy_gain"]
    after = busy["coastal_entropy"] + busy["coastal_entropy_gain"]
    np.testing.assert_allclose(after, before, atol=1e-5)
    assert (busy["coastal_entropy"] - quiet["coastal_entropy"])[context.free].mean() > -1e-3


@pytest.mark.slow
def test_quarter_turn_turns_the_layer() -> None:
    env = scenes.environment(shapely.Polygon(
        [(-1.97, -0.97), (1.97, -0.97), (1.97, 0.43), (0.63, 0.43), (0.63, 1.77), (-1.97, 1.77)]
    ))  # fmt: skip
    found = coastal_entropy(context_of(env))["coastal_entropy"]
    turned = coastal_entropy(context_of(env.transformed(math.pi / 2)))["coastal_entropy"]
    np.testing.assert_allclose(turned, np.rot90(found, -1), atol=0.02)


@pytest.mark.slow
def test_headings_and_bands_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    env = scenes.room(3.0, 2.0)
    context = context_of(env, headings=2)
    whole = coastal_entropy(context)["coastal_entropy"]
    assert whole.shape == (*context.free.shape, 2)
    # Half a turn maps the beams onto themselves.
    np.testing.assert_allclose(whole[..., 0], whole[..., 1], atol=0.01)
    monkeypatch.setattr(banding, "BAND_BYTES", 200_000)
    assert len(list(banding.bands(context, 5))) > 2
    np.testing.assert_array_equal(coastal_entropy(context)["coastal_entropy"], whole)


@pytest.mark.parametrize("people", [-0.1, math.nan, math.inf, "many"])
def test_refuses_what_is_no_number_of_people(people: float) -> None:
    context = context_of(scenes.room(1.0, 1.0))
    with pytest.raises(InputError, match="people"):
        coastal_entropy(context, people=people)


@pytest.mark.parametrize("floor", [1.0, 0.02])
@pytest.mark.parametrize("odd", [1e-6, 0.01, 0.05, 0.3, 0.99])
def test_what_a_beam_tells_is_the_mean_over_its_noise(odd: float, floor: float) -> None:
    """Of sampled readings: a small difference, and one that is as large as can be."""
    noise = np.random.default_rng(1).normal(size=200_000)
    noise = np.concatenate([noise, -noise])

    def evidence(z: Floats) -> Floats:
        return np.asarray(-np.log((1.0 - odd) * np.exp(-0.5 * z**2) + floor * odd))

    small, most = expected_evidence(odd, floor * odd)
    mean = (evidence(noise + 0.3) - evidence(noise)).mean()
    assert small == pytest.approx((1.0 - odd) * mean / (0.5 * 0.3**2), rel=0.06, abs=1e-4)
    assert most == pytest.approx(
        (1.0 - odd) * (evidence(noise + 60.0) - evidence(noise)).mean(), rel=0.02
    )
    assert 0.0 < small < 1.0
    assert 0.0 < most < -math.log(floor * odd)
