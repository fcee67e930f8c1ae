"""The filter of a forecast against its reference, closed forms, and what must not matter."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.stats import norm

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.filter_kernel import (
    FilterSettings,
    cut_off,
    forecast_rows,
    limit,
    share_within,
    take_in,
)
from ambinav.forecasting.information_field import InformationField
from tests.forecasting.reference_filter import reference

Floats = NDArray[np.float64]
START = np.diag([0.05, 0.05, 0.02]) ** 2
SETTINGS = FilterSettings(0.5, 0.4, 0.25, 0.2, 0.5, math.inf, math.radians(30.0))


def field_of(
    matrices: Floats, spacing: float = 0.1, echoes: Floats | None = None
) -> InformationField:
    """A field of matrices, (rows, columns, 3, 3), from x = y = 0 on; and what echoes tell."""
    which = (0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)
    columns = [matrices[:, :, i, j].ravel() for i, j in (*which, (0, 0))]
    if echoes is not None:
        columns += [echoes[:, :, i, j].ravel() for i, j in which]
    entries = np.column_stack(columns)
    nearest = np.arange(len(entries), dtype=np.int32).reshape(*matrices.shape[:2], 1)
    return InformationField(nearest, entries.astype(np.float32), (0.0, 0.0), spacing)


def even_field(matrix: Floats, size: int = 120, echoes: Floats | None = None) -> InformationField:
    """A field that is the same everywhere."""
    shape = size, size, 3, 3
    known = None if echoes is None else np.broadcast_to(echoes, shape)
    return field_of(np.broadcast_to(matrix, shape), echoes=known)


def run(
    poses: Floats,
    field: InformationField,
    noise: OdometryNoise,
    settings: FilterSettings = SETTINGS,
    start: Floats = START,
) -> tuple[Floats, Floats]:
    """Forecast one route."""
    covariance, lost = np.empty((len(poses), 3, 3)), np.empty(len(poses))
    forecast_rows(
        0, 1, np.array([0, len(poses)]), poses, start, field.fields, field.lattice, noise.packed,
        settings, covariance, lost,
    )  # fmt: skip
    return covariance, lost


def straight(metres: float, step: float, x: float = 1.0, y: float = 5.0) -> Floats:
    """Poses along the x axis."""
    along = np.linspace(0.0, metres, round(metres / step) + 1)
    return np.column_stack([x + along, np.full(len(along), y), np.zeros(len(along))])


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_equals_the_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(40, 40, 3, 3)) * rng.choice([0.0, 1.0, 20.0], size=(40, 40, 1, 1))
    ends = rng.normal(size=(40, 40, 3, 2)) * rng.choice([0.0, 1.0], size=(40, 40, 1, 1))
    field = field_of(
        root @ root.transpose(0, 1, 3, 2),
        echoes=ends @ ends.transpose(0, 1, 3, 2) if rng.random() < 0.7 else None,
    )
    poses = np.column_stack([rng.uniform(0.5, 3.5, (12, 2)), rng.uniform(-3.0, 3.0, 12)])
    poses[5, :2] = poses[4, :2]  # a turn on the spot
    poses[8] = poses[7]  # and none at all
    noise = OdometryNoise(scale=rng.uniform(0.1, 1.0))
    gains, lateral = rng.uniform(0.05, 2.0, 2), float(rng.choice([0.2, math.inf]))
    echo_gain = float(rng.choice([0.5, 20.0, math.inf]))
    settings = FilterSettings(*gains, 0.25, 0.2, 0.5, lateral, 0.5, echo_gain)
    for ours, theirs in zip(
        run(poses, field, noise, settings), reference(poses, START, field, noise, settings),
        strict=True,
    ):  # fmt: skip
        assert ours == pytest.approx(theirs, rel=1e-4, abs=1e-4)


def test_echoes_are_a_limit() -> None:
    noise = OdometryNoise()
    plain, echoes = np.diag([400.0, 30.0, 50.0]), np.diag([0.1, 0.0, 0.2])

    def lasting(gain: float, known: Floats | None) -> Floats:
        limited = SETTINGS._replace(echo_gain=gain)
        field = even_field(plain, echoes=known)
        return run(straight(6.0, 0.25), field, noise, limited)[0][-1].diagonal()

    free = lasting(math.inf, echoes)
    assert lasting(10.0, None) == pytest.approx(free)
    assert lasting(1e9, np.eye(3)) == pytest.approx(free, rel=1e-6)
    # Variances of two independent errors add; without an echo nothing is left.
    gain, turning = SETTINGS.gain, SETTINGS.gain * SETTINGS.turn_gain
    left = [1.0 / (1.0 / (gain * 400.0) + 1.0), 0.0, 1.0 / (1.0 / (turning * 50.0) + 0.5)]
    same = run(
        straight(6.0, 0.25), even_field(np.diag(left)), noise,
        SETTINGS._replace(gain=1.0, turn_gain=1.0),
    )  # fmt: skip
    assert lasting(10.0, echoes) == pytest.approx(same[0][-1].diagonal(), rel=1e-4)


@settings(max_examples=200)
@given(st.integers(0, 2**32 - 1))
def test_a_limited_information_is_no_more_than_its_limit(seed: int) -> None:
    """Also where both are singular but for the rounding of float32."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, rng.integers(1, 4))) * rng.choice([1e-2, 1.0, 100.0], size=(3, 1))
    ends = rng.normal(size=(3, rng.integers(0, 3))) * rng.choice([0.0, 1.0, 30.0])
    J, C = (np.asarray(part @ part.T, dtype=np.float32).astype(float) for part in (root, ends))
    kept = J.copy()
    limit(kept, C.copy(), np.empty((3, 3)))
    size = np.sqrt(np.outer(J.diagonal() + C.diagonal(), J.diagonal() + C.diagonal())) + 1e-12
    assert np.linalg.eigvalsh((C - kept) / size).min() > -1e-5
    assert np.linalg.eigvalsh(kept / size).min() > -1e-5


def test_dead_reckoning_where_nothing_tells() -> None:
    noise = OdometryNoise(scale=0.02)
    covariance, lost = run(straight(4.0, 0.25), even_field(np.zeros((3, 3))), noise)
    p, length = noise.packed, 4.0
    along = START[0, 0] + p.trans_trans * length
    turned = START[2, 2] + 2.0 * p.turn_trans * length
    # Steps of 25 cm: the sum differs from the integral 2/3 c L^3 of drive.noise by less than 1 %.
    across = START[1, 1] + START[2, 2] * length**2 + 2.0 / 3.0 * p.turn_trans * length**3
    assert covariance[-1].diagonal() == pytest.approx([along, across, turned], rel=0.01)
    assert lost[-1] < 1e-3


def test_steady_state_is_that_of_the_riccati_equation() -> None:
    """Along the travel: q a metre from odometry against b a metre from scans, sqrt(q / b)."""
    noise = OdometryNoise(scale=0.25, alpha1=0.0, alpha2=0.0)
    field = even_field(np.diag([40.0, 50.0, 50.0]))
    covariance, _ = run(straight(10.0, 0.02), field, noise)
    q, b = noise.packed.trans_trans, SETTINGS.gain * 40.0 / SETTINGS.distance
    assert covariance[-1, 0, 0] == pytest.approx(math.sqrt(q / b), rel=0.02)


@pytest.mark.parametrize("angle", [0.3, 1.0, 2.0])
def test_turning_building_and_route_changes_nothing(angle: float) -> None:
    noise = OdometryNoise(scale=0.5)
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    matrix = np.array([[0.5, 0.2, 1.0], [0.2, 6.0, 0.0], [1.0, 0.0, 20.0]])
    poses = straight(4.0, 0.25) - [3.0, 5.0, 0.0]
    turned = poses @ turn.T + np.array([0.0, 0.0, angle])
    middle = np.array([6.0, 6.0, 0.0])
    plain = run(poses + middle, even_field(matrix), noise)
    there = run(turned + middle, even_field(turn @ matrix @ turn.T), noise)
    assert there[1] == pytest.approx(plain[1], rel=1e-4, abs=1e-12)
    assert there[0] == pytest.approx(turn @ plain[0] @ turn.T, rel=1e-4, abs=1e-9)


def test_more_information_loses_fewer() -> None:
    noise = OdometryNoise(scale=0.7)
    shares = [
        run(straight(9.0, 0.25), even_field(np.diag([i, i, 10.0 * i])), noise)[1][-1]
        for i in (0.0, 0.2, 0.5, 1.0, 3.0, 10.0, 100.0)
    ]
    assert (np.diff(shares) < 0.0).all()
    assert shares[0] > 0.5 > 0.02 > shares[-1]


@pytest.mark.parametrize("metres", [4.0, 8.0, 16.0])
def test_first_passage_of_a_random_walk(metres: float) -> None:
    """Of a walk along one axis that is looked at after every step, driven 20 000 times."""
    noise = OdometryNoise(scale=0.5, alpha1=0.0, alpha2=0.0, alpha4=0.0)
    field = even_field(np.diag([0.0, 1e4, 1e4]), 200)
    start = np.diag([1e-4, 1e-4, 1e-4]) ** 2
    lost = run(straight(metres, 0.25), field, noise, start=start)[1][-1]
    steps = np.random.default_rng(5).normal(
        scale=math.sqrt(0.25 * noise.packed.trans_trans), size=(20_000, round(metres / 0.25))
    )
    share = float((np.abs(steps.cumsum(axis=1)) > SETTINGS.position_limit).any(axis=1).mean())
    # Robots that are back within a second do not count as lost; here they do.
    assert 0.7 * share < lost < 1.05 * share


def test_first_passage_of_a_walk_that_is_pulled_back() -> None:
    """As that, with scans, and with errors of the heading that become some across the way."""
    noise = OdometryNoise(scale=0.4)
    rng, poses = np.random.default_rng(6), straight(16.0, 0.25, x=0.5)
    for weak in (0.3, 1.0, 3.0):
        matrix = np.diag([weak, 2.0, 2.0])
        lost = run(poses, even_field(matrix, 200), noise)[1][-1]
        # A Kalman filter whose errors are drawn: e' = (I - K H)(F e + w) - K v.
        error = rng.multivariate_normal(np.zeros(3), START, size=4000)
        gone, steps = np.zeros(len(error), dtype=np.bool_), np.zeros(len(error), dtype=np.int64)
        P = START
        scaled = SETTINGS.gain * np.diag([weak, 2.0, 2.0 * SETTINGS.turn_gain])
        carry = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.25], [0.0, 0.0, 1.0]])
        for before, after in itertools.pairwise(poses):
            added = noise.spread(before[None], np.zeros((1, 3, 3)), before[None], after[None])[0]
            P = np.linalg.inv(np.linalg.inv(carry @ P @ carry.T + added) + scaled)
            error = error @ carry.T + rng.multivariate_normal(np.zeros(3), added, len(error))
            seen = error @ scaled + rng.multivariate_normal(np.zeros(3), scaled, len(error))
            error = error - seen @ P
            far = np.hypot(error[:, 0], error[:, 1]) > SETTINGS.position_limit
            far |= np.abs(error[:, 2]) > SETTINGS.heading_limit
            steps = np.where(far, steps + 1, 0)
            gone |= steps > 2  # for longer than a second, at 0.5 m/s
        assert 0.65 * gone.mean() < lost < gone.mean(), weak


def test_limits_along_and_across_the_heading() -> None:
    """Of a Gaussian with correlated errors, 400 000 drawn; equal limits leave the axes to count."""
    rng = np.random.default_rng(3)
    root = np.diag([0.6, 0.25, 0.2]) + 0.1 * rng.normal(size=(3, 3))
    cov, theta = root @ root.T, 0.7
    limits = SETTINGS._replace(position_limit=1.2, lateral_limit=0.3)
    error = rng.multivariate_normal(np.zeros(3), cov, size=400_000)
    c, s = math.cos(theta), math.sin(theta)
    along, across = error[:, 0] * c + error[:, 1] * s, error[:, 1] * c - error[:, 0] * s
    within = (np.abs(along) <= 1.2) & (np.abs(across) <= 0.3)
    within &= np.abs(error[:, 2]) <= limits.heading_limit
    assert 0.2 < within.mean() < 0.8
    assert share_within(cov, limits, theta) == pytest.approx(within.mean(), abs=0.02)
    # What is cut off is within the limits, and as if it were turned with the robot.
    left = cov.copy()
    assert cut_off(left, limits, theta) == pytest.approx(within.mean(), abs=0.02)
    assert np.cov(error[within].T) == pytest.approx(left, abs=0.01)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    straight_on = turn.T @ cov @ turn
    assert share_within(straight_on, limits, 0.0) == pytest.approx(share_within(cov, limits, theta))
    # Across the axes of the error itself the two kinds of limits are the same.
    apart = np.diag([0.3, 0.1, 0.02])
    alike = limits._replace(position_limit=0.4, lateral_limit=0.4)
    assert share_within(apart, alike, 0.0) == pytest.approx(
        share_within(apart, alike._replace(lateral_limit=math.inf), 0.0)
    )


@pytest.mark.slow
@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 9), st.tuples(*[st.floats(-30.0, 30.0)] * 9),
    st.integers(1, 3),
)  # fmt: skip
@example((0.0,) * 9, (0.0, 0.0, 0.0, 1.5e-156, *(0.0,) * 5), 1)
def test_taking_in_is_adding_information(
    root: tuple[float, ...], seen: tuple[float, ...], rank: int
) -> None:
    a, b = np.reshape(root, (3, 3)), np.reshape(seen, (3, 3))[:, :rank]
    covariance, information = a @ a.T + 0.01 * np.eye(3), b @ b.T
    expected = np.linalg.inv(np.linalg.inv(covariance) + information)
    take_in(covariance, information.copy())
    # Information along an axis that is below rounding beside another is left out.
    assert covariance == pytest.approx(expected, rel=1e-5, abs=1e-6)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-12


@pytest.mark.parametrize("std", [0.1, 0.3, 0.6, 2.0])
def test_cutting_off_leaves_the_second_moment(std: float) -> None:
    covariance = np.diag([std, 1e-3, 1e-3]) ** 2
    stay = cut_off(covariance, SETTINGS, 0.0)
    share = norm.cdf(0.5, scale=std) - norm.cdf(-0.5, scale=std)
    moment = quad(lambda e: e * e * norm.pdf(e, scale=std), -0.5, 0.5)[0] / share
    assert stay == pytest.approx(share, abs=1e-8)
    assert covariance[0, 0] == pytest.approx(moment, rel=1e-6)
