"""Episodes driven by the batch, held against the single environment."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav_envs.evaluation import (
    Episodes,
    episode_seeds,
    evaluate_in,
    evaluate_seeds,
    joined,
    per_metre,
)
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.policies.policy import Policy
from ambinav_envs.scenario import scenario, source_of
from ambinav_envs.simulation.layout import ARRIVED, OUTCOMES
from tests.envs.cases import room

OPTIONS: dict[str, Any] = {"longest": 5.0, "max_steps": 120, "obstacles": 2, "odometry_scale": 2.0}


class Seeker(Policy):
    """Drives at the goal, slower the less it looks there."""

    def __init__(self) -> None:
        super().__init__("seeker", {})
        self.started = 0

    def prepare(self, observation_space: Any, action_space: Any) -> None:
        self.started = 0

    def act(self, observations: Any, starts: Any) -> Any:
        self.started += int(starts.sum())
        co, si = observations["goal"][:, 1], observations["goal"][:, 2]
        return np.stack([2.0 * np.maximum(co, 0.0) ** 4 - 1.0, np.clip(2.0 * si, -1, 1)], axis=1)


def run(environment: Environment, count: int, **more: Any) -> Episodes:
    source, parameters = scenario(None, environment, None, 0, None, OPTIONS)
    return evaluate_in(Seeker(), source, parameters, count, seed=4, **more)


def single(environment: Environment, seed: int) -> dict[str, Any]:
    """The same episode in the single environment."""
    return driven(NavigationEnv(map=environment, **OPTIONS), seed)


def driven(env: NavigationEnv, seed: int, building: int | None = None) -> dict[str, Any]:
    policy = Seeker()
    seen, _ = env.reset(seed=seed, options=None if building is None else {"building": building})
    errors, total, over = [], 0.0, False
    while not over:
        rows = {name: part[None] for name, part in seen.items()}
        action = policy.act(rows, np.zeros(1, dtype=np.bool_))[0]
        seen, reward, terminated, truncated, info = env.step(action)
        errors.append(info["error"])
        total += reward
        over = terminated or truncated
    return info | {"reward": total, "errors": errors}


def test_each_episode_is_one_of_the_environment() -> None:
    environment = room()
    found = run(environment, 6)
    for k in range(6):
        wanted = single(environment, int(found.seed[k]))
        assert OUTCOMES[found.outcome[k]] == wanted["outcome"]
        for key in ("exposure", "travelled", "shortest", "was_lost"):
            assert getattr(found, key)[k] == wanted[key], key
        assert found.error_max[k] == max(wanted["errors"])
        assert found.error_mean[k] == pytest.approx(np.mean(wanted["errors"]), abs=1e-12)
        assert found.reward[k] == pytest.approx(wanted["reward"], abs=1e-9)
        assert found.seconds[k] == pytest.approx(0.2 * len(wanted["errors"]))
    assert set(found.building) == {environment.name}


def test_chunks_change_nothing() -> None:
    environment, shares = room(), []
    whole = run(environment, 7)
    parts = run(environment, 7, chunk=3, progress=shares.append)
    for name in vars(whole):
        assert np.array_equal(getattr(whole, name), getattr(parts, name)), name
    assert shares == sorted(shares) and shares[-1] == 1.0
    twice = joined([whole, parts])
    assert len(twice) == 14 and twice.ended(ARRIVED)[:7].tolist() == whole.ended(ARRIVED).tolist()


@pytest.mark.slow
def test_buildings_may_be_given() -> None:
    arguments = {"suite": "procedural", "buildings": 3, "first_building": 70, **OPTIONS}
    source, parameters = source_of(arguments)
    numbers, seeds = [72, 70, 72, 70], np.array([5, 2**62 + 1, 7, 8])
    found = evaluate_seeds(Seeker(), source, parameters, seeds, numbers, chunk=3)
    assert found.building.tolist() == [f"procedural-{number}" for number in numbers]
    env = NavigationEnv(**arguments)
    for k, (seed, number) in enumerate(zip(seeds, numbers, strict=True)):
        wanted = driven(env, int(seed), number)
        assert OUTCOMES[found.outcome[k]] == wanted["outcome"]
        assert found.travelled[k] == wanted["travelled"]


def test_every_episode_is_begun_once() -> None:
    source, parameters = scenario(None, room(), None, 0, None, OPTIONS)
    policy = Seeker()
    evaluate_in(policy, source, parameters, 5, chunk=2)
    assert policy.started == 5


class Divides(Seeker):
    """By what it sees; nobody of an episode sees zeros alone."""

    def act(self, observations: Any, starts: Any) -> Any:
        assert (1.0 / observations["goal"][:, 0] > 0.0).all()
        # The last ones never have an episode here.
        return np.concatenate([super().act(observations, starts)[:-1], [[np.nan, 0.0]]])


def test_who_stands_idle_does_no_harm() -> None:
    source, parameters = scenario(None, room(), None, 0, None, OPTIONS)
    wanted = evaluate_in(Seeker(), source, parameters, 3, seed=4, chunk=8)
    found = evaluate_in(Divides(), source, parameters, 3, seed=4, chunk=8)
    assert np.array_equal(found.travelled, wanted.travelled)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ([[0.0, 0.0], [0.0, np.nan]], "finite numbers"),
        ([[0.0, 0.0], [0.0]], "give numbers"),
        (None, "give numbers"),
        ([[0.0, 0.0]] * 3, "the shape"),
        ("left", "give numbers"),
    ],
)
def test_odd_actions_are_refused_in_one_sentence(given: Any, message: str) -> None:
    class Odd(Seeker):
        def act(self, observations: Any, starts: Any) -> Any:
            return given

    source, parameters = scenario(None, room(), None, 0, None, OPTIONS)
    with pytest.raises(InputError, match=message) as caught:
        evaluate_in(Odd(), source, parameters, 2, chunk=2)
    assert str(caught.value).startswith("policy seeker: ") and "\n" not in str(caught.value)


def test_seeds_of_episodes_stay() -> None:
    assert episode_seeds(3, 2, 2).tolist() == episode_seeds(3, 0, 4)[2:].tolist()
    assert not set(episode_seeds(3, 0, 50)) & set(episode_seeds(4, 0, 50))


def test_the_summary() -> None:
    summary = run(room(), 20).summary()
    ends = ("arrived", "missed", "collided", "lost", "timeout")
    assert sum(summary[name] for name in ends) == pytest.approx(1.0)
    assert summary["arrived"] > 0.2 and summary["length_ratio"] > 0.8
    assert 0.0 < summary["exposure_per_metre"] < 1.0


def test_exposure_per_metre_of_nobody_who_moves_is_none() -> None:
    assert np.isnan(per_metre([0.0, 0.0], [0.0, 0.0])) and per_metre([1.0, 3.0], [6.0, 2.0]) == 0.5


def test_nothing_to_do() -> None:
    with pytest.raises(InputError, match="episodes"):
        run(room(), 0)
