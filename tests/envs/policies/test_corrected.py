"""Policies that correct VFH+: what a correction does, and that they are data as others are."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from ambinav.runtime.errors import InputError
from ambinav_envs.evaluation import Episodes, evaluate_in
from ambinav_envs.policies import load_policy, read_card
from ambinav_envs.policies.card import CARD
from ambinav_envs.policies.corrected import HOLD, MOTION, CorrectedPolicy, Corrector
from ambinav_envs.policies.reactive.pace import Pace
from ambinav_envs.scenario import scenario
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED, TIMEOUT
from ambinav_envs.spaces import action_space, observation_space
from ambinav_envs.training.train import train
from ambinav_envs.training.vec import TrainingEnvs
from tests.envs.cases import equal, room
from tests.envs.training.cases import CORRECTED, tiny

SEES = {"waypoint": True, "waypoint_distance": 1.0, "window": False, "longest": 8.0}


class Always:
    """In the place of a network: the same correction always."""

    name, code, environment = "always", None, SEES

    def __init__(self, *correction: float) -> None:
        self.correction = np.array(correction)
        self.seen: list[Any] = []

    def prepare(self, observation_space: Any, action_space: Any) -> None:
        assert MOTION in observation_space.spaces

    def act(self, observations: Any, starts: Any) -> Any:
        self.seen.append(observations[MOTION][0].copy())
        return np.tile(self.correction, (len(starts), 1))


def corrected(model: Any) -> CorrectedPolicy:
    return CorrectedPolicy(model, "vfh")


def episodes(policy: Any, count: int = 6, **options: Any) -> Episodes:
    source, parameters = scenario(None, room(), None, 0, None, {**SEES, **options})
    return evaluate_in(policy, source, parameters, count, 1, chunk=count)


@pytest.mark.slow
def test_as_fast_as_it_may_it_is_the_baseline() -> None:
    options = {"obstacles": 6, "people": 2, "odometry_scale": 2.0}
    ours, theirs = (
        episodes(policy, **options) for policy in (corrected(Always(0.0, 1.0)), load_policy("vfh"))
    )
    equal(vars(ours), vars(theirs))


@pytest.mark.slow
def test_without_a_correction_it_takes_the_time_it_has() -> None:
    fast = episodes(load_policy("vfh"), 12, localizer="perfect", odometry_scale=0.0)
    found = episodes(corrected(Always(0.0, 0.0)), 12, localizer="perfect", odometry_scale=0.0)
    assert found.ended(ARRIVED).all()
    assert (found.seconds > 1.3 * fast.seconds).all() and found.seconds.max() < 60.0
    # Four times as slow again; near the end of its time a quarter of the speed is left.
    slow = episodes(
        corrected(Always(0.0, -1.0)), localizer="perfect", odometry_scale=0.0, max_steps=20
    )
    assert slow.ended(TIMEOUT).all() and (slow.travelled < 0.25 * 0.5 * 4.0).all()


def test_the_pace() -> None:
    _, parameters = scenario(None, room(), None, 0, None, {**SEES, "dt": 0.1, "max_steps": 100})
    pace, goal = Pace(parameters), np.array([[0.1, 1.0, 0.0], [0.0, 1.0, 0.0]], np.float32)
    pace.step(np.array([True, True]))
    # 1.5 times 2 m in 10 s, of 0.5 m/s; and the least share.
    assert pace.share(goal) == pytest.approx([0.6, 0.3])
    for _ in range(60):
        pace.step(np.array([False, False]))
    assert pace.share(goal) == pytest.approx([1.0, 0.75])


@pytest.mark.slow
def test_a_correction_of_zero_is_the_paced_baseline() -> None:
    options = {"obstacles": 6, "people": 2, "odometry_scale": 2.0, "ambiguity_weight": 5.0}
    ours, theirs = (
        episodes(policy, **options)
        for policy in (corrected(Always(0.0, 0.0)), load_policy("vfh-paced"))
    )
    equal(vars(ours), vars(theirs))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_target_is_turned(side: float) -> None:
    _, parameters = scenario(None, room(), None, 0, None, SEES)
    corrector = Corrector("vfh")
    corrector.configure(parameters)
    corrector.prepare(observation_space(parameters), action_space(parameters))
    seen = {
        "scan": np.ones((1, 60), np.float32),
        "velocity": np.zeros((1, 2), np.float32),
        "goal": np.array([[0.3, 1.0, 0.0]], np.float32),
        "waypoint": np.array([[0.1, 1.0, 0.0]], np.float32),
    }
    corrector.see(seen, np.array([True]))
    (action,) = corrector.steer(seen, np.array([True]), np.array([[side, 0.0]]))
    assert np.sign(action[1]) == side


@pytest.mark.slow(kept=("correction1",))
@pytest.mark.parametrize("correction", [(1.0, 1.0), (-1.0, 0.0), (0.4, -0.3)])
def test_whatever_the_correction_it_stops_before_walls(correction: tuple[float, float]) -> None:
    found = episodes(corrected(Always(*correction)), 12, obstacles=8, localizer="perfect")
    assert not found.ended(COLLIDED).any()


@pytest.mark.slow
def test_what_it_knows_of_the_last_seconds() -> None:
    model = Always(0.0, 0.0)
    episodes(corrected(model), 1, max_steps=50, localizer="perfect")
    motion = np.array(model.seen)
    assert not motion[0].any()
    assert np.allclose(np.diff(motion[:, 2]), HOLD / 50.0, atol=1e-6)
    # A mean lags behind what is driven.
    assert motion[1, 0] < 0.2 < motion[-1, 0] <= 1.0


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training of two rounds."""
    folder = tmp_path_factory.mktemp("corrected") / "run"
    train(tiny(**CORRECTED), folder)
    return folder


@pytest.mark.slow
def test_a_training_leaves_a_file_that_is_data(run: Path) -> None:
    file = run / "final.zip"
    assert read_card(file).base == "vfh" and file.stat().st_size < 1_000_000
    policy = load_policy(file)
    assert isinstance(policy, CorrectedPolicy) and not policy.is_code
    # It drives as it did when it was judged.
    card = read_card(file)
    arguments = {name: value for name, value in policy.environment.items() if name != "suite"}
    source, parameters = scenario("hall", None, 1, 2, None, arguments)
    found = evaluate_in(policy, source, parameters, 4, 0).summary()
    assert found["reward"] == pytest.approx(card.notes["evaluation"]["reward"], rel=1e-6)


@pytest.mark.slow
def test_another_base_is_refused(run: Path, tmp_path: Path) -> None:
    odd = tmp_path / "odd.zip"
    with zipfile.ZipFile(run / "final.zip") as old, zipfile.ZipFile(odd, "w") as new:
        for name in old.namelist():
            content = old.read(name)
            if name == CARD:
                content = json.dumps({**json.loads(content), "base": "os.system"}).encode()
            new.writestr(name, content)
    with pytest.raises(InputError, match=r"base is 'os\.system'"):
        load_policy(odd)
    with pytest.raises(InputError, match="base"):
        tiny(base="dwa")
    with pytest.raises(InputError, match="recurrent-ppo cannot correct"):
        tiny(base="vfh", algorithm="recurrent-ppo")
    with pytest.raises(InputError, match="waypoint"):
        TrainingEnvs(tiny(base="vfh", environment={**CORRECTED["environment"], "waypoint": False}))


@pytest.mark.slow
def test_the_environments_of_a_training_agree_with_the_policy() -> None:
    """Corrections go the same way in training and in judging."""
    envs = TrainingEnvs(tiny(**CORRECTED))
    seen = envs.outer.reset()
    zero, latest = np.zeros((8, 2), np.float32), 0.0
    for _ in range(40):
        before = seen
        seen, _, done, infos = envs.outer.step(zero)
        # The next episode may have begun within the step.
        assert (seen[MOTION][done, 2] < HOLD / 30.0).all()
        latest = max(latest, seen[MOTION][:, 2].max())
        for i in np.flatnonzero(done):
            last = infos[i]["terminal_observation"]
            assert last.keys() == seen.keys()
            # Of a time step before, which may be the one after `before`.
            assert (np.abs(last[MOTION] - before[MOTION][i]) <= HOLD / 30.0 + 1e-6).all()
    assert latest > 0.1
    envs.close()
