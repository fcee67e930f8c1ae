"""Beliefs that a robot gives: their numbers, their score, and what is refused."""

from __future__ import annotations

import math

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from ambinav.runtime.errors import InputError
from ambinav_envs.beliefs import as_beliefs, belief_numbers, filter_belief
from ambinav_envs.commands import NOTHING_KNOWN, by_filter
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.belief import LEAST_STD, MOST_STD, UNIFORM
from tests.envs.cases import room

ROW = st.lists(st.floats(-1.0, 1.0), min_size=9, max_size=9)


def environment(**options: object) -> NavigationEnv:
    given_too = {"localizer": "ekf", "window": False, "belief": True, **options}
    return NavigationEnv(map=room(), **given_too)  # type: ignore[arg-type]


def score_of(
    numbers: np.ndarray, estimate: np.ndarray, truth: np.ndarray, area: float
) -> np.ndarray:
    """The score by SciPy's normal density and turns of the heading, of true poses (..., 3)."""
    offset, cov = (part[0] for part in as_beliefs(numbers[None]))
    c, s = math.cos(estimate[2]), math.sin(estimate[2])
    off = truth - estimate
    ahead = off[..., :2] @ np.array([[c, -s], [s, c]])
    turns = [np.append(ahead, off[..., 2:] + 2.0 * math.pi * k, axis=-1) for k in range(-4, 5)]
    density = multivariate_normal.pdf(turns, offset, cov).sum(axis=0)
    even = 1.0 / (area * 2.0 * math.pi)
    return np.log(((1.0 - UNIFORM) * density + UNIFORM * even) / even)


@given(ROW)
def test_every_action_is_a_belief_and_comes_back(numbers: list[float]) -> None:
    row = np.array([numbers])
    offset, cov = as_beliefs(row)
    assert np.linalg.eigvalsh(cov)[0, 0] > 0.0
    std = np.sqrt(np.diagonal(cov[0]))
    assert (std >= np.multiply(LEAST_STD, 1.0 - 1e-9)).all()
    assert (std <= np.multiply(MOST_STD, 1.0 + 1e-9)).all()
    again = as_beliefs(belief_numbers(offset, cov))
    assert again.covariance == pytest.approx(cov, rel=1e-6)
    assert again.offset[:, :2] == pytest.approx(offset[:, :2])
    assert math.remainder(again.offset[0, 2] - offset[0, 2], 2.0 * math.pi) == pytest.approx(
        0.0, abs=1e-9
    )


@pytest.mark.parametrize("latency", [0.0, 0.5])
def test_the_score_is_scipys(latency: float) -> None:
    """Of the pose at which the robot has observed, from the estimate that it has seen."""
    env = environment(pose_latency=latency, reward={"belief": 2.0})
    area = 15.0 * 12.0
    rng = np.random.default_rng(1)
    env.reset(seed=3, options={"start": (3.0, 2.0, 3.0)})
    for _ in range(20):
        (estimate,), _ = env.simulation.seen()
        truth = env.simulation.state["truth"][0].copy()
        numbers = rng.uniform(-1.0, 1.0, 9) * rng.choice([0.01, 0.1, 1.0])
        expected = score_of(numbers, estimate, truth, area)
        _, reward, *_, info = env.step(np.concatenate([[-0.8, 0.3], numbers]))
        dt = env.simulation.parameters.dt
        assert info["terms"]["belief"] == pytest.approx(dt * expected, abs=1e-9)
        assert reward == pytest.approx(2.0 * dt * expected, abs=1e-9)


def test_it_is_proper() -> None:
    """Who says what it believes scores most on the mean, whatever else it might say."""
    rng = np.random.default_rng(2)
    true = belief_numbers(
        [[0.3, -0.2, 0.5]], [[[0.3, 0.1, 0.02], [0.1, 0.2, -0.05], [0.02, -0.05, 0.1]]]
    )
    offset, cov = as_beliefs(true)
    poses = rng.multivariate_normal(offset[0], cov[0], 400)
    estimate = np.zeros(3)
    own = score_of(true[0], estimate, poses, 200.0)
    for k in range(9):
        for change in (-0.2, 0.2):
            other = true[0].copy()
            other[k] += change
            gain = own - score_of(other, estimate, poses, 200.0)
            assert gain.mean() > 0.0, (k, change)


def test_bounds_of_the_score() -> None:
    """Sure and wrong costs no more than ln of the even share; knowing nothing gives about 0."""
    env = environment(localizer="perfect")
    env.reset(seed=1, options={"start": (3.0, 2.0, 0.0)})
    wrong = np.array([-1.0, 0.0, 0.5, 0.5, 0.0, -1.0, -1.0, -1.0, 0.0, 0.0, 0.0])
    dt = env.simulation.parameters.dt
    assert env.step(wrong)[4]["terms"]["belief"] / dt == pytest.approx(math.log(UNIFORM))
    nothing = np.concatenate([[-1.0, 0.0], NOTHING_KNOWN])
    assert -4.0 < env.step(nothing)[4]["terms"]["belief"] / dt < 0.5


def test_the_filters_belief_is_what_it_shows() -> None:
    seen, _ = (env := environment()).reset(seed=1)
    for _ in range(5):
        seen, *_ = env.step(np.concatenate([[0.0, 0.4], NOTHING_KNOWN]))
    rows = {name: part[None] for name, part in seen.items()}
    offset, cov = as_beliefs(filter_belief(rows))
    mean, held = (part[0] for part in env.simulation.seen())
    c, s = math.cos(mean[2]), math.sin(mean[2])
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    own = turn @ held @ turn.T
    own[2, :2] = own[:2, 2] = 0.0
    floor = np.maximum(np.sqrt(np.diagonal(own)), LEAST_STD)
    assert not offset.any()
    assert np.sqrt(np.diagonal(cov[0])) == pytest.approx(floor, rel=2e-2)
    parameters = env.simulation.parameters
    action = by_filter(np.array([[0.2, 0.1]]), rows, parameters)
    assert action.shape == (1, 11) and action[0, 2:] == pytest.approx(filter_belief(rows)[0])


@given(
    along=st.floats(0.0, 2.0, width=32), across=st.floats(0.0, 2.0, width=32),
    angle=st.floats(-math.pi, math.pi), heading=st.floats(0.0, 2.0, width=32),
)  # fmt: skip
def test_any_uncertainty_is_a_belief(
    along: float, across: float, angle: float, heading: float
) -> None:
    wide, thin = max(along, across), min(along, across)
    row = np.float32([[wide, thin, math.cos(angle), math.sin(angle), heading]])
    cov = as_beliefs(filter_belief({"uncertainty": row})).covariance[0]
    if thin > 0.02 and wide < 7.0 * thin:
        # Within the correlations that can be given; the axis lies at half of that angle.
        u = np.array([math.cos(angle / 2.0), math.sin(angle / 2.0)])
        assert u @ cov[:2, :2] @ u == pytest.approx(wide**2, rel=1e-3)
    assert np.linalg.eigvalsh(cov)[0] > 0.0


def test_refusals() -> None:
    env = environment(declare=["arrived"])
    env.reset(seed=1)
    with pytest.raises(InputError, match="declarations and belief from -1 to 1"):
        env.step(np.array([0.0, 0.0, 1.5, *np.zeros(9)]))
    with pytest.raises(InputError, match="nine numbers of the belief"):
        env.step(np.zeros(3))
    with pytest.raises(InputError, match="belief takes continuous actions"):
        NavigationParameters(belief=True, discrete=True)
    eye = np.eye(3)[None]
    for bad, cov in (
        ("positive definite", -eye),
        ("positive definite", np.array([[[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])),
        ("symmetric", np.array([[[1.0, 0.5, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]])),
        ("positive definite", np.full((1, 3, 3), math.nan)),
        ("shapes", np.eye(3)),
    ):
        with pytest.raises(InputError, match=bad):
            belief_numbers(np.zeros((1, 3)), cov)
    with pytest.raises(InputError, match=r"shape \(9,\); give finite ones, \(N, 9\)"):
        as_beliefs(np.zeros(9))
    with pytest.raises(InputError, match="not finite"):
        belief_numbers(np.full((1, 3), math.inf), eye)


def test_belief_ids() -> None:
    env = gym.make("ambinav/AccurateGoal-Belief-v1", buildings=1)
    parameters = env.unwrapped.simulation.parameters  # type: ignore[attr-defined]
    assert env.action_space.shape == (12,) and parameters.declare == ("arrived",)
    assert parameters.weights[-1] > 0.0


def test_no_second_of_belief_earns_what_it_costs() -> None:
    """Of the surest one that can be given, in a building of 100 x 100 m."""
    sure = np.array([[0.0, 0, 0, -1, -1, -1, *signs] for signs in np.ndindex(3, 3, 3)])
    sure[:, 6:] -= 1.0
    _, covariances = as_beliefs(sure)
    densities = 1.0 / np.sqrt((2.0 * math.pi) ** 3 * np.linalg.det(covariances))
    most = math.log(float(densities.max()) * 1e4 * 2.0 * math.pi)
    ids = [name for name in gym.registry if name.startswith("ambinav/") and "-Belief-" in name]
    assert len(ids) > 8
    for name in ids:
        weights = gym.spec(name).kwargs["reward"]
        assert 0.0 < most * weights["belief"] < weights["time"], name


@pytest.mark.parametrize("name", ["Navigation-Belief-v1", "TwinRooms1-Belief-v2"])
def test_nobody_is_paid_for_standing(name: str) -> None:
    env = gym.make(f"ambinav/{name}", buildings=1)
    seen, _ = env.reset(seed=1)
    total = 0.0
    for _ in range(20):
        belief = filter_belief({"uncertainty": seen["uncertainty"][None]})[0]
        seen, reward, *_ = env.step(np.concatenate([[-1.0, 0.0, -1.0], belief]))
        total += float(reward)
    assert total < 0.0
