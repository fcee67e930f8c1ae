"""The tree search agrees with exact values of small POMDPs."""

from __future__ import annotations

import importlib
from itertools import product
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
LISTEN, LEFT, RIGHT = range(3)
HEARD, BEHIND, TREASURE, LISTENING = 0.85, -100.0, 10.0, -1.0


@pytest.fixture(autouse=True)
def benchmarks_on_the_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))


def script(name: str) -> ModuleType:
    return importlib.import_module(name)


class Tiger:
    """The problem of Kaelbling, Littman and Cassandra (1998), which ends when a door is opened."""

    def actions(self, state: int) -> tuple[int, ...]:
        return LISTEN, LEFT, RIGHT

    def step(
        self, state: int, action: int, rng: np.random.Generator
    ) -> tuple[int | None, int, float]:
        if action == LISTEN:
            truly = rng.random() < HEARD
            return state, state if truly else LEFT + RIGHT - state, LISTENING
        return None, 0, BEHIND if action == state else TREASURE

    def rollout(self, state: int, rng: np.random.Generator) -> float:
        """Open nothing."""
        return 0.0


def tiger_value(left: float, depth: int) -> tuple[int, float]:
    """Return the best action and its value where the tiger is left with this probability."""
    if depth == 0:
        return LISTEN, 0.0
    listening = LISTENING
    for heard_left in (True, False):
        p_left = left * (HEARD if heard_left else 1.0 - HEARD)
        p_right = (1.0 - left) * (1.0 - HEARD if heard_left else HEARD)
        total = p_left + p_right
        listening += total * tiger_value(p_left / total, depth - 1)[1]
    values = {
        LISTEN: listening,
        LEFT: left * BEHIND + (1.0 - left) * TREASURE,
        RIGHT: left * TREASURE + (1.0 - left) * BEHIND,
    }
    best = max(values, key=values.__getitem__)
    return best, values[best]


@pytest.mark.parametrize("left", [0.5, 0.85, 0.03])
def test_the_tiger_is_listened_to_until_one_is_sure(left: float) -> None:
    search = script("pomcp").Pomcp(Tiger(), simulations=20_000, exploration=30.0, depth=3)
    action, value = search.plan(
        lambda rng: LEFT if rng.random() < left else RIGHT, np.random.default_rng(1)
    )
    best, exact = tiger_value(left, 3)
    assert action == best
    assert value == pytest.approx(exact, abs=1.0)


def look_model() -> Any:
    """Two hypotheses and a third; the first place tells one from the others, the second all."""
    pomcp = script("belief_pomcp")
    apart = np.array([[0.0, 3.0, 1.0], [3.0, 0.0, 4.0], [1.0, 4.0, 0.0]])
    evidence = np.zeros((3, 3, 2))
    for j, k in product(range(3), repeat=2):
        if j != k:
            evidence[j, k] = (2.0 if 0 in (j, k) else 0.0), 3.0
    to_goal = np.array([[5.0, 2.0, 6.0], [5.0, 8.0, 6.0], [7.0, 7.0, 6.0]])
    return pomcp.LookModel(evidence, to_goal, apart, pomcp.Prices(1.0, 1.0, 0.03, 0.5)), evidence


def exact_values(
    model: Any, evidence: Any, state: Any, speed: float, second: float, apart: Any, depth: int
) -> dict[int, float]:
    """Return the value of each action by expectimax over beliefs."""
    values = {0: max(model.end(state, k) for k in range(len(state.belief)))}
    likelihood = np.exp(-evidence)
    likelihood = likelihood / likelihood.sum(axis=0)
    for place in range(evidence.shape[2]) if depth > 1 else ():
        if state.been >> place & 1:
            continue
        seconds = apart[state.place][place] / speed
        value = -second * seconds
        for taken in range(len(state.belief)):
            weights = np.array(state.belief) * likelihood[taken, :, place]
            belief = tuple((weights / weights.sum()).tolist())
            after = state._replace(
                place=place, left=state.left - seconds, belief=belief, been=state.been | 1 << place
            )
            further = exact_values(model, evidence, after, speed, second, apart, depth - 1)
            value += weights.sum() * max(further.values())
        values[place + 1] = value
    return values


@pytest.mark.parametrize(
    "belief", [(0.4, 0.3, 0.3), (0.9, 0.05, 0.05), (0.1, 0.45, 0.45), (0.98, 0.01, 0.01)]
)
@pytest.mark.parametrize("left", [100.0, 15.0])
def test_looks_and_ends_have_the_value_of_an_exhaustive_search(
    belief: tuple[float, ...], left: float
) -> None:
    pomcp = script("belief_pomcp")
    model, evidence = look_model()
    apart = np.array([[0.0, 3.0, 1.0], [3.0, 0.0, 4.0], [1.0, 4.0, 0.0]])
    now = pomcp.Looking(0, 2, left, belief, 0)
    exact = exact_values(model, evidence, now, 0.5, 0.03, apart, 3)
    search = script("pomcp").Pomcp(model, simulations=4000, exploration=0.3, depth=3)
    cumulated = np.cumsum(belief)[:-1]
    action, value = search.plan(
        lambda rng: now._replace(truth=int(np.searchsorted(cumulated, rng.random()))),
        np.random.default_rng(1),
    )
    best = max(exact.values())
    assert exact[action] == pytest.approx(best, abs=0.02)
    assert value == pytest.approx(best, abs=0.05)


def test_one_look_is_the_search_of_depth_two() -> None:
    pomcp = script("belief_pomcp")
    model, evidence = look_model()
    apart = np.array([[0.0, 3.0, 1.0], [3.0, 0.0, 4.0], [1.0, 4.0, 0.0]])
    belief = np.array([0.4, 0.35, 0.25])
    now = pomcp.Looking(0, 2, 1e6, tuple(belief.tolist()), 0)
    exact = exact_values(model, evidence, now, 0.5, 0.03, apart, 2)
    to_goal = np.array([[5.0, 2.0], [5.0, 8.0], [7.0, 7.0]])
    prices = pomcp.Prices(1.0, 1.0, 0.03, 0.5)
    values = pomcp.one_look(evidence, to_goal, apart[-1, :-1], belief, prices)
    np.testing.assert_allclose(values, [exact[1], exact[2]], rtol=1e-12)


@pytest.mark.slow
def test_the_tree_search_drives_the_same_episodes_again() -> None:
    study, methods = script("study_twin_rooms"), script("belief_methods")
    options = {**study.IDS["ambinav/TwinRooms1-v2"], "buildings": 2}
    key = {"episodes": 4, "seed": 3}
    first, second = (
        study.driven_by(methods.BELIEF_METHODS["pomcp"], key, options, None) for _ in range(2)
    )
    assert first.ended(study.ARRIVED).sum() >= 3
    np.testing.assert_array_equal(first.seconds, second.seconds)
