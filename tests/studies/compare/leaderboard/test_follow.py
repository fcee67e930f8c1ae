"""Routes followed in the environment: they lead around walls, and plans are made once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("ompl")

from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav_envs.commands import as_commands
from ambinav_envs.evaluation import Episodes, evaluate_in
from ambinav_envs.leaderboard.methods import RouteFollower, planner_method
from ambinav_envs.leaderboard.routes import PlannerChoice, Routes
from ambinav_envs.leaderboard.waypoint import WaypointFollower
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.scenario import scenario
from ambinav_envs.simulation.layout import ARRIVED
from ambinav_envs.simulation.simulation import Simulation
from tests.envs.cases import room

OPTIONS = {"longest": 12.0, "shortest": 4.0, "localizer": "perfect"}


def driven(follower: RouteFollower, environment: Environment, count: int = 6) -> Episodes:
    source, parameters = scenario(None, environment, None, 0, None, dict(OPTIONS))
    return evaluate_in(follower, source, parameters, count, seed=1, chunk=8)


@pytest.mark.slow
@pytest.mark.parametrize(
    "choice",
    [PlannerChoice("reference", 0.0), PlannerChoice("belief"), PlannerChoice("prmstar", 5.0, 200)],
)
def test_all_arrive_who_know_where_they_are(choice: PlannerChoice) -> None:
    found = driven(RouteFollower(choice), room())
    assert found.ended(ARRIVED).all()
    if choice.weight == 0.0:
        # The goal counts as reached 0.3 m before it, and lattice paths are up to 3 % too long.
        assert ((found.length_ratio > 0.85) & (found.length_ratio < 1.05)).all()


def test_planners_know_what_the_localizer_knows(monkeypatch: pytest.MonkeyPatch) -> None:
    """Odometry that errs more than the localizer assumes is not known to planners either."""
    robots = []
    plain = Routes._robot

    def kept(self: Routes, *given: Any) -> Any:
        robots.append(plain(self, *given))
        return robots[-1]

    monkeypatch.setattr(Routes, "_robot", kept)
    options = {
        "odometry": OdometryNoise(scale=0.4),
        "odometry_scale": 2.0,
        "start_std": (0.2, 0.1, 0.03),
    }
    source, parameters = scenario(None, room(), None, 0, None, {**OPTIONS, **options})
    follower = planner_method("belief 5", PlannerChoice("belief")).make(parameters)
    assert isinstance(follower, RouteFollower)
    evaluate_in(follower, source, parameters, 1, seed=1, chunk=8)
    assert robots
    for robot in robots:
        assert robot.odometry == OdometryNoise(scale=0.4)
        assert robot.belief.start_std == (0.2, 0.1, 0.03)


@pytest.mark.sweep
def test_routes_are_the_same_again_and_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    environment, choice = room(), PlannerChoice("prmstar", 5.0, 100)
    first, again = RouteFollower(choice), RouteFollower(choice)
    wanted = driven(first, environment)
    assert np.array_equal(driven(again, environment).travelled, wanted.travelled)
    first.routes.save(tmp_path / "routes.npz")
    third = RouteFollower(choice)
    third.routes.load(tmp_path / "routes.npz")
    monkeypatch.setattr(Routes, "_planned", None)
    assert np.array_equal(driven(third, environment).travelled, wanted.travelled)


def test_a_damaged_file_of_routes_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "routes.npz").write_bytes(b"PK nothing")
    routes = Routes(PlannerChoice("reference"))
    routes.load(tmp_path / "routes.npz")
    routes.load(tmp_path / "none.npz")
    assert routes.plan([], []) == []


def test_routes_keep_off_walls_as_far_as_there_is_room() -> None:
    environment = room()
    source, parameters = scenario(None, environment, None, 0, None, dict(OPTIONS))
    simulation = Simulation(source, parameters, 8)
    rngs = [np.random.default_rng(k) for k in range(8)]
    simulation.reset(range(8), rngs, None, simulation.outcome())
    buildings = [site.building for site in simulation.sites if site is not None]
    tasks = [task for task in simulation.tasks if task is not None]
    for poses, task in zip(
        Routes(PlannerChoice("reference", 0.0)).plan(buildings, tasks), tasks, strict=True
    ):
        assert poses is not None
        assert poses[0].tolist() == task.start.tolist()
        assert poses[-1, :2].tolist() == task.goal.tolist()
        x, y = poses[2:-2, 0], poses[2:-2, 1]
        assert environment.is_free(x, y, radius=Robot().radius + 0.099).all()


@pytest.mark.parametrize(
    "options",
    [
        {"robot": {"max_speed": 1.2, "max_turn_rate": 1.0}, "min_speed": -0.3},
        {"robot": {"max_speed": 0.3}, "discrete": False},
    ],
)
def test_the_waypoint_follower_goes_by_the_robot_it_drives(options: dict[str, Any]) -> None:
    """Far from the waypoint it drives at full speed, beside it it stands and turns."""
    parameters = NavigationParameters(**options)
    follower = WaypointFollower(parameters)
    # Straight ahead, to the left, behind on the right.
    seen = {"waypoint": np.array([[0.1, 1.0, 0.0], [0.1, 0.0, 1.0], [0.1, -1.0, -0.1]])}
    speeds = as_commands(follower.act(seen, np.zeros(3, dtype=np.bool_)), parameters)
    fastest, turning = parameters.robot.max_speed, parameters.robot.max_turn_rate
    assert speeds[:, 0].tolist() == pytest.approx([fastest, 0.0, 0.0])
    assert speeds[:, 1].tolist() == pytest.approx([0.0, turning, -turning])


def test_without_a_route_a_robot_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Routes, "plan", lambda self, buildings, tasks: [None] * len(tasks))
    found = driven(RouteFollower(PlannerChoice("reference")), room(), 2)
    assert (found.travelled == 0.0).all() and not found.ended(ARRIVED).any()


def test_an_unknown_planner() -> None:
    with pytest.raises(InputError, match="did you mean prmstar"):
        Routes(PlannerChoice("prmstr"))
