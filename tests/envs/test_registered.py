"""Tasks that are registered, and environments that somebody wrapped and registered himself."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import ambinav_envs
from ambinav import plugins
from ambinav.plugins import InstalledEntry
from ambinav.runtime.errors import InputError
from ambinav_envs.arena import Arena
from ambinav_envs.difficulty import LEVELS
from ambinav_envs.leaderboard.evaluated import JUDGED, environment_for
from ambinav_envs.leaderboard.methods import PLANNERS, planner_method
from ambinav_envs.policies.card import Card, arguments_of, plain_environment
from ambinav_envs.policies.policy import CallablePolicy, Policy
from ambinav_envs.policies.reactive.policy import ReactivePolicy
from ambinav_envs.registered import arguments_of_id, is_wrapped
from ambinav_envs.registration import IDS, TASKS, register_envs
from ambinav_envs.robot_states import EpisodeEnd, Stepped
from ambinav_envs.sb3 import make_sb3
from ambinav_envs.simulation.layout import OUTCOMES
from ambinav_envs.task_spec import DrawContext, TaskSpec
from tests.envs.cases import equal, room

STAND = np.array([-1.0, 0.0], dtype=np.float32)
AHEAD = np.array([1.0, 0.0], dtype=np.float32)


def in_the_corner(context: DrawContext) -> Any:
    xmin, ymin, _, _ = context.environment.bounds
    assert not context.fits(xmin, ymin) and context.shortest < context.longest
    return (xmin + 1.0 + context.rng.uniform(), ymin + 1.0, 0.0), None


def who_has_moved(stepped: Stepped, ends: np.ndarray) -> np.ndarray:
    return np.where(stepped.driven > 0.03, EpisodeEnd.ARRIVED, ends)


def wrapped(**arguments: Any) -> gym.Env[Any, Any]:
    inner = ambinav_envs.NavigationEnv(**{"map": room(), "window": False, **arguments})
    return gym.wrappers.TransformReward(inner, lambda reward: reward + 1.0)


def flat(**arguments: Any) -> gym.Env[Any, Any]:
    return gym.wrappers.FlattenObservation(ambinav_envs.NavigationEnv(map=room(), **arguments))


class Faulty(gym.Wrapper[Any, Any, Any, Any]):
    """It fails in reset or step, repeats actions, or hides the info."""

    def __init__(self, env: gym.Env[Any, Any], fault: str) -> None:
        super().__init__(env)
        self.fault, self.closed = fault, False

    def reset(self, *, seed: Any = None, options: Any = None) -> Any:
        if self.fault == "reset":
            raise RuntimeError("no\nluck")
        return super().reset(seed=seed, options=options)

    def step(self, action: Any) -> Any:
        if self.fault == "step":
            return [][1]
        result = super().step(action)
        if self.fault == "repeats":
            result = super().step(action)
        return (*result[:4], {}) if self.fault == "info" else result

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def ids(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    before = dict(gym.registry)
    monkeypatch.setattr(TASKS, "_registered", {})
    arguments = {"map": room(), "window": False, "localizer": "odometry", "max_steps": 9}
    TASKS.register(
        TaskSpec(
            name="mine/Corner-v0",
            about="leave the corner",
            arguments=arguments,
            draw=in_the_corner,
            judge=who_has_moved,
        )
    )
    gym.register("mine/Wrapped-v0", entry_point=wrapped)
    gym.register("mine/Flat-v0", entry_point=flat)
    gym.register("mine/Closed-v0", entry_point=lambda: wrapped())
    yield
    for name in gym.registry.keys() - before.keys():
        del gym.registry[name]


def test_ends_have_the_numbers_of_the_outcomes() -> None:
    assert tuple(end.name.lower() for end in EpisodeEnd) == OUTCOMES


def test_what_is_shipped_is_in_the_registry() -> None:
    for name in TASKS.names():
        if name in IDS:
            assert dict(TASKS.get(name).arguments) == IDS[name] == arguments_of_id(name)
    with pytest.raises(InputError, match="there is no task 'ambinav/Hal-v0'; did you mean"):
        TASKS.get("ambinav/Hal-v0")
    with pytest.raises(InputError, match="task 'Hall': the name is not an id"):
        TaskSpec(name="Hall", about="")


def test_a_twin_leaves_its_name_to_a_task(ids: None) -> None:
    TASKS.register(TaskSpec(name="mine/Door-TruePose-v0", about="a task"))
    door = TaskSpec(name="mine/Door-v0", about="another")
    assert TASKS.register(door) is TASKS.register(door)
    assert gym.registry["mine/Door-TruePose-v0"].kwargs == {"task": "mine/Door-TruePose-v0"}
    assert gym.registry["mine/Door-NoMap-v0"].kwargs == {
        "task": "mine/Door-v0",
        "ambiguity_seen": False,
    }
    for name, taken in (
        ("mine/Flat-v0", "mine/Flat-v0"),
        ("mine/Corner-NoMap-v0", "mine/Corner-NoMap-v0"),
        ("ambinav/Hall-TruePose-v1", "ambinav/Hall-TruePose-v1"),
    ):
        with pytest.raises(InputError, match=f"task '{taken}': Gymnasium has another environ"):
            TASKS.register(TaskSpec(name=name, about=""))
        assert name not in TASKS.names()


def test_a_plug_in_with_a_taken_name_is_left_out(
    ids: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = dict(gym.registry)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register_envs()
    assert gym.registry == before
    entries: list[InstalledEntry] = []
    monkeypatch.setattr(plugins, "_entry_points", lambda group: entries)
    for names, message in (
        (("mine/Window-v0", "mine/Window-NoMap-v0"), None),
        (("ambinav/Hall-NoMap-v1",), "left out: task 'ambinav/Hall-NoMap-v1': Gymnasium has anot"),
        (("ambinav/Hall-v1",), "left out: task 'ambinav/Hall-v1' is both in ambinav and in stran"),
    ):
        entries += [InstalledEntry(name, "nowhere_here:TASK", "stranger") for name in names]
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            register_envs()
        assert len(caught) == (message is not None)
        assert all(str(message) in str(warning.message) for warning in caught)
    assert gym.registry["mine/Window-NoMap-v0"].kwargs == {"task": "mine/Window-NoMap-v0"}
    assert gym.registry["mine/Window-TruePose-v0"].kwargs["task"] == "mine/Window-v0"
    assert gym.registry["ambinav/Hall-v1"].kwargs == IDS["ambinav/Hall-v1"]
    listed = TASKS.listed()
    assert [entry.name for entry in listed if entry.error is None] == [
        entry.name for entry in listed if entry.distribution != "stranger"
    ]
    assert "is both in ambinav and in stranger" in str(listed[-2].error)


@pytest.mark.parametrize(
    ("given", "first"), [({}, 100), ({"first_building": 0}, 0), ({"first_building": 7}, 7)]
)
def test_the_first_building_of_a_task_may_be_another(
    ids: None, given: dict[str, Any], first: int
) -> None:
    arguments = {"suite": "office", "buildings": 3, "first_building": 100}
    TASKS.register(TaskSpec(name="mine/Tail-v0", about="a task", arguments=arguments))
    source = gym.make("mine/Tail-v0", **given).unwrapped.simulation.source
    assert (source.first, source.count) == (first, 3)


def test_a_task_draws_and_judges(ids: None) -> None:
    env = gym.make("mine/Corner-v0")
    many = gym.make_vec("mine/Corner-v0", num_envs=3, vectorization_mode="vector_entry_point")
    _, info = env.reset(seed=4)
    assert 1.0 <= info["true_pose"][0] <= 2.0 and info["true_pose"][1] == 1.0
    assert np.array_equal(many.reset(seed=3)[1]["true_pose"][1], info["true_pose"])
    outcome = None
    while outcome is None:
        _, reward, ended, _, info = env.step(AHEAD)
        outcome = info.get("outcome")
        assert reward == pytest.approx(sum(info["reward_terms"].values()))
        assert info["reward_terms"]["arrival"] == 1.0 * ended
    assert outcome == "arrived" and info["is_success"] and info["travelled"] < 0.2
    # Whoever does not move runs out of time as ever.
    env.reset(seed=4)
    assert [env.step(STAND)[3] for _ in range(9)] == [False] * 8 + [True]
    twin = gym.make("mine/Corner-TruePose-v0", max_steps=5)
    parameters = twin.unwrapped.simulation.parameters  # type: ignore[attr-defined]
    assert (parameters.localizer, parameters.max_steps) == ("perfect", 5)
    with pytest.raises(InputError, match="there is no task 'mine/Corer-v0'; did you mean mine"):
        gym.make("ambinav/Navigation-v1", task="mine/Corer-v0")


@pytest.mark.parametrize(
    ("field", "gives", "message"),
    [
        ("draw", None, "cannot unpack"),
        ("draw", ((0.0, 0.0, 0.0), None), r"task 'mine/Corner-v0': start \(0, 0\)"),
        ("judge", None, "judge gave an array of object"),
        ("judge", np.array([7]), "judge gave 7 to 7"),
    ],
)
def test_a_task_that_gives_what_cannot_be_used(
    ids: None, field: str, gives: Any, message: str
) -> None:
    object.__setattr__(TASKS.get("mine/Corner-v0"), field, lambda *given: gives)
    env = gym.make("mine/Corner-v0")
    with pytest.raises(InputError, match=message):
        env.reset(seed=0)
        env.step(AHEAD)


@pytest.mark.slow
def test_a_wrapped_environment_is_driven_by_itself(ids: None) -> None:
    assert is_wrapped("mine/Wrapped-v0") and not is_wrapped("ambinav/Hall-v1")
    given = {"max_steps": 60, "longest": 4.0}
    around = Arena.of("mine/Wrapped-v0", given)
    plain = Arena.of(None, {"map": room(), "window": False, **given})
    assert around.parameters == plain.parameters or around.parameters.max_steps == 60
    for arena in (around, plain):
        assert arena.changed(localizer="perfect").parameters.localizer == "perfect"
    for make in (
        lambda parameters: ReactivePolicy("vfh"),
        planner_method("shortest", PLANNERS["shortest"]).make,
    ):
        seeing = {"waypoint": True, "discrete": False}
        runs = [
            arena.changed(**seeing).evaluate(make(arena.parameters), 3, 1)
            for arena in (around, plain)
        ]
        assert np.array_equal(runs[0].outcome, runs[1].outcome)
        assert np.allclose(runs[0].travelled, runs[1].travelled)
        steps = runs[0].seconds / around.parameters.dt
        assert np.allclose(runs[0].reward, runs[1].reward + steps)


def trained_in(name: str, **arguments: Any) -> Policy:
    def make(*spaces: Any) -> None:
        raise AssertionError

    make.environment = {"id": name, **arguments}  # type: ignore[attr-defined]
    return CallablePolicy(make, "mine.py:make")


def test_a_policy_is_evaluated_as_it_was_trained_in_a_wrapped_environment(ids: None) -> None:
    gym.register(
        "mine/Suite-v0",
        entry_point=lambda **given: wrapped(
            **{"map": None, "suite": "office", "people": 2, **given}
        ),
    )
    name = "mine/Suite-v0"
    own = {"people": 3, "max_steps": 7, "window": True}
    hall = {"suite": "hall", "buildings": 4, "first_building": 9}
    policy = trained_in(name, **own, **hall)
    assert environment_for(policy, {}) == {"id": name, "suite": "hall", **own, **JUDGED}
    # What was changed replaces it, and what the id says itself is left out.
    changed: dict[str, Any] = {"people": 1, "suite": "loop", "buildings": 5}
    kept = {"max_steps": 7, "window": True}
    assert environment_for(policy, changed) == {"id": name, **kept, **JUDGED, **changed}
    changed = {"suite": None, "map": room()}
    assert environment_for(policy, changed) == {"id": name, **own, **changed}
    said = trained_in(name, people=2, suite="office", declare=(), robot={})
    assert environment_for(said, {}) == {"id": name, **JUDGED}
    # In a task that was asked for it keeps what it sees.
    assert environment_for(policy, {}, name) == {"id": name, "window": True, **JUDGED}


def of_a_card(name: str, **arguments: Any) -> Policy:
    """A policy with the card that a training writes: all parameters, plain, in JSON."""
    environment = plain_environment({**arguments_of_id(name, arguments), "id": name})
    card = Card("PPO", json.loads(json.dumps(environment)), {}, {}, 0, None)
    return trained_in(**{"name": name, **arguments_of(card)})


def test_a_policy_of_a_wrapped_map_brings_what_its_card_says(ids: None) -> None:
    name, arguments = "mine/Wrapped-v0", {"people": 5, "difficulty": 1}
    policy = of_a_card(name, **arguments)
    given = environment_for(policy, {})
    assert given.keys() == {"id", "people", "difficulty", *LEVELS[1]}
    own = {key: value for key, value in given.items() if key != "id"}
    assert Arena.of(name, own).parameters == Arena.of(name, arguments).parameters
    # Another difficulty sets what that of the training did, and leaves what was given.
    other = {"difficulty": 3}
    assert environment_for(policy, other) == {"id": name, "people": 5, **other}
    assert environment_for(of_a_card("mine/Closed-v0"), {}) == {"id": "mine/Closed-v0"}


def test_a_wrapped_environment_for_stable_baselines(ids: None) -> None:
    envs = make_sb3("mine/Wrapped-v0", 2, seed=3)
    ours = make_sb3("ambinav/Navigation-v1", 2, seed=3, map=room(), window=False)
    equal(envs.reset(), ours.reset())
    for _ in range(3):
        own, other = envs.step(np.tile(AHEAD, (2, 1))), ours.step(np.tile(AHEAD, (2, 1)))
        equal(own[0], other[0])
        assert np.allclose(own[1], other[1] + 1.0)


def test_a_wrapper_may_end_episodes(ids: None) -> None:
    gym.register("mine/Short-v0", entry_point=wrapped, max_episode_steps=1)
    envs = make_sb3("mine/Short-v0", 2)
    envs.reset()
    # Who drives may collide in its first step, if it starts beside a wall.
    _, _, done, infos = envs.step(np.tile(STAND, (2, 1)))
    assert done.all() and {info["outcome"] for info in infos} == {"timeout"}


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("reset", r"reset failed \(RuntimeError: no luck, test_registered.py line \d+\); fix"),
        ("step", r"step failed \(IndexError: list index out of range, test_registered.py line"),
        ("repeats", "one step of it makes 2 of NavigationEnv"),
        ("info", "the info of a step lacks cost_collision, cost_lost, cost, error, .*, was_lost;"),
    ],
)
def test_wrappers_that_fail_in_an_episode(ids: None, fault: str, message: str) -> None:
    made: list[Faulty] = []

    def faulty(**arguments: Any) -> gym.Env[Any, Any]:
        made.append(Faulty(wrapped(**arguments), fault))
        return made[-1]

    gym.register("mine/Faulty-v0", entry_point=faulty)

    def evaluated() -> None:
        Arena.of("mine/Faulty-v0", {"max_steps": 4}).evaluate(ReactivePolicy("vfh"), 1, 1)

    def trained() -> None:
        # By this seed no robot runs into a wall in its first steps, which would end the episode.
        envs = make_sb3("mine/Faulty-v0", 2, seed=3)
        envs.reset()
        envs.step(np.tile(AHEAD, (2, 1)))

    for used in (evaluated, trained):
        with pytest.raises(InputError, match=rf"^mine/Faulty-v0: {message}") as caught:
            used()
        assert "\n" not in str(caught.value) and str(caught.value).endswith(".")
        if used is evaluated:
            assert made[-1].closed


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("mine/Flat-v0", {}, r"observation_space \(Box \(\d+,\)\) has other parts"),
        ("mine/Closed-v0", {"people": 1}, "it cannot be made with people"),
        ("mine/Wrapped-v0", {"poeple": 1}, "mine/Wrapped-v0: .*did you mean people"),
        ("CartPole-v1", {}, "CartPoleEnv, in which there is no NavigationEnv"),
        ("mine/Wraped-v0", {}, "the id is 'mine/Wraped-v0'; did you mean mine/Wrapped-v0"),
        ("nothing-like-it", {}, "choose from ambinav/"),
        ("nowhere_here:mine/A-v0", {}, "nowhere_here cannot be imported"),
    ],
)
def test_ids_that_cannot_be_used(ids: None, name: str, given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        arguments_of_id(name, given)
    assert "\n" not in str(caught.value) and str(caught.value).endswith(".")
