"""Actions as speeds: what the kernel drives, what controllers are asked for, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambinav.runtime.errors import InputError
from ambinav_envs.commands import as_actions, as_commands, at_goal, by_filter
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.spaces import ACTIONS, continuous
from tests.envs.cases import room

CHOICES: list[dict[str, Any]] = [{"min_speed": least} for least in (0.0, -0.3)]


@pytest.mark.parametrize("options", CHOICES)
@given(
    share=st.floats(-1.5, 1.5).map(lambda x: round(x, 6)),
    turn=st.floats(-1.0, 1.0).map(lambda x: round(x, 6)),
)
def test_actions_of_commands_ask_for_them(
    options: dict[str, Any], share: float, turn: float
) -> None:
    parameters = NavigationParameters(robot={"max_speed": 0.8, "max_turn_rate": 1.5}, **options)
    commands = as_commands(np.array([[share, turn]]), parameters)
    assert parameters.min_speed <= commands[0, 0] <= 0.8 and commands[0, 1] == 1.5 * turn
    again = as_commands(as_actions(commands, parameters), parameters)
    assert again == pytest.approx(commands, abs=1e-12)


@pytest.mark.parametrize("options", CHOICES)
@pytest.mark.parametrize("share", [-2.0, -1.0, -0.4, 0.0, 0.3, 1.0, 2.0])
def test_the_simulation_drives_them(options: dict[str, Any], share: float) -> None:
    """Acceleration is no limit here, so the speed of a step is the one that was asked for."""
    robot = {"max_speed": 0.8, "max_turn_rate": 1.5, "acceleration": 100.0}
    env = NavigationEnv(map=room(), robot=robot, localizer="perfect", window=False, **options)
    env.reset(seed=1, options={"start": (3.0, 2.0, 0.0)})
    env.step(np.array([share, 0.2]))
    wanted = as_commands(np.array([[share, 0.2]]), env.simulation.parameters)[0, 0]
    assert env.simulation.state["speeds"][0, 0] == wanted


def test_zeros_are_the_middle_of_the_speeds() -> None:
    middle = as_commands(np.zeros((1, 2)), NavigationParameters(min_speed=-0.2))
    assert middle.tolist() == [[pytest.approx(0.15), 0.0]]


@pytest.mark.parametrize("least", [0.0, -0.3])
def test_discrete_actions_are_shares_of_the_highest_speeds(least: float) -> None:
    p = NavigationParameters(discrete=True, min_speed=least)
    commands = as_commands(continuous(np.arange(9), 9, p), p)
    highest = p.robot.max_speed, p.robot.max_turn_rate
    np.testing.assert_allclose(commands, ACTIONS * highest, rtol=0.0, atol=1e-15)


def test_who_declares_what() -> None:
    both = NavigationParameters(declare=["lost", "arrived"])
    assert both.declare == ("arrived", "lost") and both.columns == 4
    there, astray = np.array([True, False, True]), np.array([False, False, True])
    said = as_actions(np.zeros((3, 2)), both, there, astray)[:, 2:]
    assert said.tolist() == [[1.0, -1.0], [-1.0, -1.0], [1.0, 1.0]]
    silent = NavigationParameters()
    assert as_actions(np.zeros((3, 2)), silent, there, astray).shape == (3, 2)
    discrete = NavigationParameters(declare=["arrived", "lost"], discrete=True)
    assert continuous(np.array([9, 10, 7]), 3, discrete)[:, 2:].tolist() == [[1, 0], [0, 1], [0, 0]]
    with pytest.raises(InputError, match="declare is 'arived'; did you mean arrived"):
        NavigationParameters(declare=["arived"])
    with pytest.raises(InputError, match="give a list of names"):
        NavigationParameters(declare="arrived")


def test_who_trusts_its_filter_stands_where_it_declares() -> None:
    seen = {"goal": np.array([[0.02, 1.0, 0.0], [0.5, 1.0, 0.0]], np.float32)}
    parameters = NavigationParameters(declare=["arrived"])
    said = by_filter(np.full((2, 2), 0.4), seen, parameters)
    assert as_commands(said, parameters).tolist() == [[0.0, 0.0], pytest.approx([0.4, 0.4])]
    assert said[:, 2].tolist() == [1.0, -1.0]


def test_who_is_at_the_goal_by_its_estimate() -> None:
    seen = {
        "goal": np.array([[0.029, 1.0, 0.0], [0.031, 1.0, 0.0], [0.0, 1.0, 0.0]], np.float32),
        "uncertainty": np.array([[0.05], [0.05], [0.2]], np.float32),
    }
    declares = NavigationParameters(declare=["arrived"])
    assert at_goal(seen, declares).tolist() == [True, False, True]
    sure = NavigationParameters(declare=["arrived"], goal_std=0.1)
    assert at_goal(seen, sure).tolist() == [True, False, False]
    # Who cannot declare it need not see the goal.
    assert not at_goal({"scan": np.zeros((3, 60))}, NavigationParameters()).any()
