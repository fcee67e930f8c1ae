"""The filter of a forecast against its reference, closed forms, and what must not matter."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import eigh_tridiagonal

from ambinav.drive.noise import OdometryNoise
from ambinav.forecast.filter_kernel import FilterSettings, forecast_rows, take_in
from ambinav.forecast.information_field import InformationField
from tests.forecast.reference_filter import rate, reference

Floats = NDArray[np.float64]
START = np.diag([0.05, 0.05, 0.02]) ** 2
SETTINGS = FilterSettings(0.5, 0.4, 0.25, 0.2, 0.3, 0.5, math.radians(30.0))


def field_of(matrices: Floats, spacing: float = 0.1) -> InformationField:
    """A field of information matrices, (rows, columns, 3, 3), from x = y = 0 on."""

    def part(i: int, j: int) -> NDArray[np.float32]:
        return np.ascontiguousarray(matrices[:, :, i, j, np.newaxis], dtype=np.float32)

    entries = [part(*ij) for ij in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))]
    return InformationField(*entries, part(0, 0), (0.0, 0.0), spacing)


def even_field(matrix: Floats, size: int = 120) -> InformationField:
    """A field that is the same everywhere."""
    return field_of(np.broadcast_to(matrix, (size, size, 3, 3)))


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


@given(st.integers(0, 2**32 - 1))
def test_equals_the_reference(seed: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(40, 40, 3, 3)) * rng.choice([0.0, 1.0, 20.0], size=(40, 40, 1, 1))
    field = field_of(root @ root.transpose(0, 1, 3, 2))
    poses = np.column_stack([rng.uniform(0.5, 3.5, (12, 2)), rng.uniform(-3.0, 3.0, 12)])
    poses[5, :2] = poses[4, :2]  # a turn on the spot
    poses[8] = poses[7]  # and none at all
    noise = OdometryNoise(scale=rng.uniform(0.1, 1.0))
    settings = FilterSettings(
        rng.uniform(0.05, 2.0), rng.uniform(0.05, 2.0), 0.25, 0.2, rng.uniform(), 0.5, 0.5
    )
    for ours, theirs in zip(
        run(poses, field, noise, settings), reference(poses, START, field, noise, settings),
        strict=True,
    ):  # fmt: skip
        assert ours == pytest.approx(theirs, rel=1e-5, abs=1e-6)


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


@pytest.mark.parametrize("along", [0.0, 0.5, 2.0])
def test_steps_do_not_matter(along: float) -> None:
    noise = OdometryNoise(scale=0.5)
    field = even_field(np.diag([along, 8.0, 10.0]))
    coarse, fine = (run(straight(9.0, step), field, noise) for step in (0.25, 0.02))
    assert coarse[1][-1] == pytest.approx(fine[1][-1], rel=0.1)
    assert coarse[0][-1] == pytest.approx(fine[0][-1], rel=0.1, abs=1e-3)


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


def test_first_passage_of_a_random_walk() -> None:
    """Of a walk along one axis, against the series of the heat equation with absorbing ends."""
    noise = OdometryNoise(scale=0.5, alpha1=0.0, alpha2=0.0, alpha4=0.0)
    field = even_field(np.diag([0.0, 1e4, 1e4]))
    start = np.diag([1e-4, 1e-4, 1e-4]) ** 2
    poses = straight(10.0, 0.05)
    lost = run(poses, field, noise, start=start)[1]
    b = SETTINGS.position_limit
    for metres, off in ((4.0, 0.5), (10.0, 0.1)):
        d = 0.5 * noise.packed.trans_trans * metres
        stay = sum(
            4.0 / (math.pi * (2 * k + 1)) * (-1) ** k
            * math.exp(-d * ((2 * k + 1) * math.pi / (2.0 * b)) ** 2)
            for k in range(50)
        )  # fmt: skip
        share = lost[np.searchsorted(poses[:, 0] - 1.0, metres - 1e-9)]
        # Where few have left the true share is twice that of a Gaussian (reflection principle).
        assert share == pytest.approx(1.0 - stay, rel=off), metres


@pytest.mark.parametrize("pull", [0.0, 0.5, 2.0, 5.0, 9.0])
def test_rate_is_that_of_the_quasi_stationary_distribution(pull: float) -> None:
    """Of an Ornstein-Uhlenbeck process with unit noise between absorbing ends at -1 and 1."""
    x = np.linspace(-1.0, 1.0, 2001)[1:-1]
    step = x[1] - x[0]
    # The Fokker-Planck operator, made symmetric (Risken 1989, section 5.4).
    diagonal = 1.0 / step**2 + (pull**2 * x**2 - pull) / 2.0
    beside = np.full(len(x) - 1, -0.5 / step**2)
    values, vectors = eigh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))
    density = np.abs(vectors[:, 0]) * np.exp(-pull * x**2 / 2.0)
    variance = float((density * x**2).sum() / density.sum())
    assert rate(variance, 1.0) == pytest.approx(values[0], rel=0.06)


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 9), st.tuples(*[st.floats(-30.0, 30.0)] * 9),
    st.integers(1, 3),
)  # fmt: skip
def test_taking_in_is_adding_information(
    root: tuple[float, ...], seen: tuple[float, ...], rank: int
) -> None:
    a, b = np.reshape(root, (3, 3)), np.reshape(seen, (3, 3))[:, :rank]
    covariance, information = a @ a.T + 0.01 * np.eye(3), b @ b.T
    expected = np.linalg.inv(np.linalg.inv(covariance) + information)
    take_in(covariance, information.copy())
    assert covariance == pytest.approx(expected, rel=1e-5, abs=1e-8)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-12
