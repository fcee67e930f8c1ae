"""The reactive baselines as policies: how they are named, what they fit, and that they arrive."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

pytest.importorskip("gymnasium")

from ambinav.cli import app
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav_envs.commands import as_commands
from ambinav_envs.evaluation import Episodes, evaluate_in
from ambinav_envs.leaderboard.methods import all_methods, policy_method
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.load import checksum_of, load_policy
from ambinav_envs.policies.reactive.policy import REACTIVE, ReactivePolicy
from ambinav_envs.scenario import scenario
from ambinav_envs.simulation.layout import ARRIVED, COLLIDED
from ambinav_envs.spaces import action_space, observation_space
from tests.envs.cases import equal, room

ALL = pytest.mark.parametrize(
    "name",
    [
        # One of each kind is quick.
        name if name in ("dwa", "vfh-aware") else pytest.param(name, marks=pytest.mark.slow)
        for name in REACTIVE
    ],
)
DEMO = str(Path(__file__).parents[3] / "configs" / "demo.geojson")


def episodes(name: str, count: int, **options: Any) -> Episodes:
    policy = load_policy(name)
    source, parameters = scenario(
        None, room(), None, 0, None, {**policy.environment, "longest": 8.0, **options}
    )
    return evaluate_in(policy, source, parameters, count, 1, chunk=count)


@pytest.mark.slow
@ALL
def test_they_arrive_among_boxes_without_a_collision(name: str) -> None:
    found = episodes(name, 8, obstacles=8, people=2, localizer="perfect")
    assert not found.ended(COLLIDED).any()
    assert found.ended(ARRIVED).mean() >= 0.75


@pytest.mark.slow(kept=("vfh-hc-sr04",))
@pytest.mark.parametrize("scanner", ["rplidar-a1", "sick-tim571", "polaroid-6500-ring", "hc-sr04"])
@pytest.mark.parametrize("name", ["vfh", "dwa"])
def test_any_scanner_will_do(name: str, scanner: str) -> None:
    """From 8 cones of sonar to a laser that does not look back."""
    found = episodes(name, 6, scanner=scanner, obstacles=4, localizer="perfect")
    assert found.ended(COLLIDED).sum() <= 1
    assert found.ended(ARRIVED).sum() >= 3


@pytest.mark.slow
@ALL
def test_the_same_episodes_twice(name: str) -> None:
    one, other = (episodes(name, 3, obstacles=4, max_steps=80) for _ in range(2))
    equal(vars(one), vars(other))


def test_two_routes() -> None:
    weights = {name: load_policy(name).environment["ambiguity_weight"] for name in REACTIVE}
    aware = {"vfh-aware": 5.0, "dwa-aware": 5.0, "vfh-paced": 5.0}
    assert weights == {"vfh": 0.0, "dwa": 0.0, **aware}


def test_they_are_on_the_leaderboard() -> None:
    methods = {method.name: method for method in all_methods([], [])}
    assert set(REACTIVE) <= set(methods)
    assert methods["vfh-aware"].shipped and "VFH+" in methods["vfh-aware"].text
    assert methods["vfh"].seeing["waypoint"] is True
    # Named by the user, one takes part once.
    named = [method.name for method in all_methods([], ["dwa"])]
    assert named.count("dwa") == 1
    texts = {json.dumps(policy_method(name).identity) for name in REACTIVE}
    assert len(texts) == len(REACTIVE)


def test_checksums() -> None:
    found = {checksum_of(name, load_policy(name)) for name in REACTIVE}
    assert len(found) == len(REACTIVE)
    assert checksum_of("vfh", load_policy("vfh")) == checksum_of("vfh", load_policy("vfh"))


def test_a_wrong_name_is_told_the_nearest() -> None:
    with pytest.raises(InputError, match="dwa"):
        load_policy("dwaa")


def test_what_does_not_fit_is_named() -> None:
    policy = ReactivePolicy("vfh")
    sees = {**policy.environment}
    for changed, message in (
        ({"discrete": True}, "discrete=false"),
        ({"waypoint": False}, "waypoint=true"),
        ({"scanner": "rplidar-a1"}, "the part 'scan' has"),
    ):
        parameters = NavigationParameters.of({**sees, **changed})
        with pytest.raises(InputError, match=message):
            policy.prepare(observation_space(parameters), action_space(parameters))
    parameters = NavigationParameters.of({**sees, "scanner": "rplidar-a1"})
    policy.configure(parameters)
    policy.prepare(observation_space(parameters), action_space(parameters))


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(list(REACTIVE)),
    st.sampled_from(["all", "ahead", "cones", "many"]),
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.0, -0.5]),
)
def test_actions_are_finite_and_in_the_box(name: str, kind: str, seed: int, least: float) -> None:
    """Whatever is seen, also what no environment would show: actions are those of the box."""
    laser = RangeSensor(max_range=4.0, std=0.0, resolution=0.01, min_range=0.1)
    cone = RangeSensor(max_range=3.0, std=0.0, resolution=0.01, aperture=0.5)
    scanner = {
        "all": RangeScanner.planar(laser, 36, 6.283185307179586),
        "ahead": RangeScanner.planar(laser, 20, 1.5, (0.1, 0.0, 0.3)),
        "cones": RangeScanner.ring(cone, 7, 0.15),
        "many": RangeScanner.planar(laser, 300, 4.5),
    }[kind]
    policy, rng = ReactivePolicy(name), np.random.default_rng(seed)
    parameters = NavigationParameters(scanner=scanner, waypoint=True, min_speed=least)
    policy.configure(parameters)
    policy.prepare(observation_space(parameters), action_space(parameters))
    for step in range(4):
        scan = rng.choice([0.0, 0.05, 0.3, 1.0, np.nan], (3, scanner.beams))
        angle = rng.uniform(-np.pi, np.pi, 3)
        far = rng.choice([0.0, 1e-9, 0.1, 10.0], 3)
        seen = {
            "scan": scan.astype(np.float32),
            "goal": np.zeros((3, 3), np.float32),
            "velocity": rng.uniform(-1.0, 1.0, (3, 2)).astype(np.float32),
            "waypoint": np.stack([far, np.cos(angle), np.sin(angle)], axis=1).astype(np.float32),
        }
        actions = policy.act(seen, np.full(3, step == 0))
        assert actions.shape == (3, 2) and np.isfinite(actions).all()
        assert np.abs(actions).max() <= 1.0
        assert (as_commands(actions, parameters)[:, 0] >= 0.0).all()


def test_one_environment_of_gymnasium() -> None:
    policy = load_policy("vfh")
    env = NavigationEnv(map=room(), longest=4.0, **policy.environment)
    policy.prepare(env.observation_space, env.action_space)
    seen, info = env.reset(seed=1)
    for step in range(300):
        rows = {name: part[None] for name, part in seen.items()}
        seen, _, over, cut, info = env.step(policy.act(rows, np.array([step == 0]))[0])
        if over or cut:
            break
    assert info["outcome"] == "arrived"


@pytest.mark.sweep
def test_evaluate_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AMBINAV_CACHE", str(tmp_path / "cache"))
    words = ["evaluate", "dwa", "--map", DEMO, "-n", "2", "ambiguity_weight=2", "max_steps=20"]
    done = CliRunner().invoke(app, [*words, "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["policy"] == "dwa" and report["environment"]["ambiguity_weight"] == 2
    refused = CliRunner().invoke(app, [*words, "discrete=true"])
    assert refused.exit_code == 2 and "discrete=false" in refused.stderr
