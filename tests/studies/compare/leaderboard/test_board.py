"""A small leaderboard from end to end: what is written, and going on after a break."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("ompl")

from ambinav.drive.bootstrap import Interval
from ambinav.geometry.environment import Environment
from ambinav.runtime import provenance
from ambinav.runtime.errors import InputError, InputWarning
from ambinav_envs.leaderboard import board as board_module
from ambinav_envs.leaderboard import report as report_module
from ambinav_envs.leaderboard.board import CONDITIONS, Board, Setting, Venue, fitting, settings_for
from ambinav_envs.leaderboard.methods import (
    TRUE_POSE,
    all_methods,
    follower_method,
    planner_methods,
    policy_method,
    true_pose_method,
)
from ambinav_envs.leaderboard.normalized import BLIND
from ambinav_envs.leaderboard.report import STUDY, benchmark
from ambinav_envs.leaderboard.routes import Routes
from ambinav_envs.leaderboard.store import key_of, load_episodes, save_episodes
from tests.envs.cases import room

HERE = Path(__file__).parent
CONFIGS = HERE.parents[3] / "configs"
OPTIONS = {"longest": 5.0, "max_steps": 150}


def small(environment: Environment, **changed: Any) -> Board:
    place = Venue("room", environment, None)
    values: dict[str, Any] = {
        "methods": [
            *planner_methods(["reference:0.5"]),
            policy_method("plug.py:spinner", HERE, trust=True),
        ],
        "settings": [Setting(f"room, {name}", place, name) for name in CONDITIONS],
        "episodes": 4,
        "seed": 3,
        "options": OPTIONS,
    }
    return Board(**{**values, **changed})


@pytest.mark.slow
def test_what_is_written(tmp_path: Path) -> None:
    board = small(room())
    rows = benchmark(board, tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(
        name for name in STUDY.folder.names if not name.endswith(".svg")
    )
    assert [(row.setting, row.method) for row in rows] == [
        (f"room, {name}", method)
        for name in CONDITIONS
        for method in ("shortest", "reference 0.5", "plug.py:spinner")
    ]
    for row in rows:
        key = "timeout" if row.method == "plug.py:spinner" else "arrived"
        if row.setting == "room, as mapped":
            assert row[key].value.value == 100.0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert len(report["rows"]) == 6 and report["episodes"] == 4 and report["baseline"] == "shortest"
    assert report["rows"][0]["figures"]["arrived"]["value"] == 100.0
    text = (tmp_path / "out" / "report.md").read_text()
    assert "## Room, disturbed" in text and "obstacles 6, people 3" in text
    lines = text.splitlines()
    # Tables are in one piece, and rows as wide as their headings.
    for at, line in enumerate(lines):
        if line.startswith("|---"):
            assert lines[at - 1].count("|") == line.count("|") == lines[at + 1].count("|")


@pytest.mark.slow
def test_scores_are_normalized_by_the_shortest_routes_and_their_twin(tmp_path: Path) -> None:
    methods = [*planner_methods([])[:1], follower_method(5.0), true_pose_method()]
    hard = {"odometry_scale": 4.0, "start_std": (0.3, 0.3, 0.1), "longest": 12.0}
    board = small(room(), methods=methods, options=hard, episodes=24)
    rows = benchmark(board, tmp_path / "out")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    text = (tmp_path / "out" / "report.md").read_text()
    table = (tmp_path / "out" / "table.csv").read_text()
    for setting in board.settings:
        by = report["normalized_by"][setting.name]
        own = {row.method: row for row in rows if row.setting == setting.name}
        assert by["blind"]["arrived"]["value"] == own[BLIND]["arrived"].value.value
        assert own[TRUE_POSE]["missed"].value.value == own[TRUE_POSE]["lost"].value.value == 0.0
        assert own[TRUE_POSE]["error"].value.value == own[TRUE_POSE]["lost_time"].value.value == 0
        assert by["room"]["low"] > 0.0
        scores = {name: row.score for name, row in own.items()}
        assert scores[BLIND] == Interval(0.0, 0.0, 0.0, 24)
        assert scores[TRUE_POSE] == Interval(1.0, 1.0, 1.0, 24)
        # The reward of who follows another route is another one.
        assert own[BLIND]["return"].value.count == 24
        assert own["waypoint follower 5"]["return"].value.count == 0
        assert f"{setting.name},{BLIND},normalized_score,,24,24,0,0,0,,," in table.replace('"', "")
    rewards = {(row["setting"], row["method"]): row["reward"] for row in report["rows"]}
    assert rewards["room, as mapped", "waypoint follower 5"] is None
    assert rewards["room, as mapped", BLIND] is not None
    assert "| shortest | 0.00 [0.00, 0.00] |" in text and "room for +" in text
    # Both follow the same routes, which are planned once.
    assert len(list((tmp_path / "out" / "work").glob("routes-*.npz"))) == 1


@pytest.mark.sweep
def test_going_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    environment = room()
    benchmark(small(environment), tmp_path / "whole")
    drive: Callable[..., Any] = board_module._drive
    drives = []

    def interrupted(*arguments: Any) -> Any:
        if len(drives) == 3:
            raise KeyboardInterrupt
        drives.append(arguments[2].name)
        return drive(*arguments)

    monkeypatch.setattr(board_module, "_drive", interrupted)
    with pytest.raises(KeyboardInterrupt):
        benchmark(small(environment), tmp_path / "out")
    assert drives == ["shortest", "shortest", "reference 0.5"]
    monkeypatch.setattr(board_module, "_drive", lambda *a: drives.append(a[2].name) or drive(*a))
    benchmark(small(environment), tmp_path / "out")
    assert drives[3:] == ["reference 0.5", "plug.py:spinner", "plug.py:spinner"]
    for name in ("table.csv", "report.md"):
        assert (tmp_path / "out" / name).read_text() == (tmp_path / "whole" / name).read_text()
    # Another method more drives alone.
    more = small(environment, methods=planner_methods(["reference:0.5", "reference:2"]))
    benchmark(more, tmp_path / "out")
    assert drives[6:] == ["reference 2"] * 2


def test_what_changes_the_episodes_changes_their_key() -> None:
    environment = room()
    one = small(environment)
    setting, method = one.settings[0], one.methods[1]
    keys = {one.key(setting, method), one.key(setting, one.methods[0])}
    keys.add(one.key(one.settings[1], method))
    for changed in ({"episodes": 5}, {"seed": 4}, {"options": {"longest": 6.0}}):
        keys.add(small(environment, **changed).key(setting, method))
    assert len(keys) == 6
    assert small(room()).key(setting, method) in keys


@pytest.mark.slow
def test_episodes_in_files(tmp_path: Path) -> None:
    board = small(room(), methods=planner_methods([])[:1])
    found = board_module.run(board, tmp_path, lambda text: lambda share: None)
    episodes = found["room, as mapped"]["shortest"]
    save_episodes(episodes, tmp_path / "a.npz")
    again = load_episodes(tmp_path / "a.npz")
    assert again is not None and again.building.tolist() == episodes.building.tolist()
    (tmp_path / "a.npz").write_bytes((tmp_path / "a.npz").read_bytes()[:100])
    assert load_episodes(tmp_path / "a.npz") is None


def test_planners_read_the_layer_of_all_and_steer_by_speed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Options that all have in common reach the planners, and their routes are distinguished."""
    layers: list[str] = []

    def plan(routes: Routes, buildings: Any, tasks: Any) -> list[None]:
        layers.append(routes.layer)
        return [None] * len(tasks)

    monkeypatch.setattr(Routes, "plan", plan)
    environment, methods = room(), planner_methods([])[:1]
    for layer in ("level", "fisher"):
        options = OPTIONS | {"layer": layer, "discrete": True, "max_steps": 2}
        one = small(environment, methods=methods, options=options, episodes=1)
        assert not one.parameters(one.settings[0], methods[0]).discrete
        assert fitting(one).methods == methods
        board_module.run(one, tmp_path, lambda text: lambda share: None)
    assert layers == ["level", "level", "fisher", "fisher"]
    assert len(list(tmp_path.glob("routes-*.npz"))) == 2


def test_the_key_holds_versions_of_what_policies_are_made_of(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    keys = {key_of({})}
    assert key_of({}) in keys
    version = provenance.library_version
    for name in ("torch", "stable-baselines3", "ompl", "numba"):
        monkeypatch.setattr(
            provenance, "library_version", lambda n, name=name: "0" if n == name else version(n)
        )
        keys.add(key_of({}))
    assert len(keys) == 5


def test_settings() -> None:
    demo = CONFIGS / "demo.geojson"
    names = [setting.name for setting in settings_for([demo], 7)]
    assert names == [
        "procedural, as mapped", "procedural, disturbed", "hall, as mapped", "hall, disturbed",
        "demo, as mapped", "demo, disturbed",
    ]  # fmt: skip
    assert [one.place.count for one in settings_for([], 7, ["hall", "office"])] == [7] * 4
    with pytest.raises(InputError, match="hall"):
        settings_for([], 7, ["hal"])
    with pytest.raises(InputError, match="two places are called 'demo'"):
        settings_for([demo, demo], 7)


PICKY = """
from ambinav.runtime.errors import InputError, InputWarning


def picky(observation_space, action_space):
    raise InputError("it sees nothing.")


def deep(observation_space, action_space):
    return None


deep.environment = {"layer": "fisher"}
"""


def test_who_does_not_fit(tmp_path: Path) -> None:
    (tmp_path / "picky.py").write_text(PICKY)
    picky = policy_method("picky.py:picky", tmp_path, trust=True)
    board = small(room(), methods=[*planner_methods([])[:1], picky])
    with pytest.raises(InputError, match="it sees nothing"):
        fitting(board)
    kept = small(room(), methods=[board.methods[0], replace(picky, shipped=True)])
    with pytest.warns(InputWarning, match="left out: it sees nothing"):
        assert [method.name for method in fitting(kept).methods] == ["shortest"]
    deep = policy_method("picky.py:deep", tmp_path, trust=True)
    with pytest.raises(InputError, match="trained to see the layer 'fisher'"):
        fitting(small(room(), methods=[deep]))


@pytest.mark.parametrize(
    ("condition", "message"),
    [
        ({"scanner": "rplidar-a1"}, "scanner is given, but buildings, scanner"),
        ({"nonsense": 1}, "the key 'nonsense' is unknown"),
        ({"start_unknown": True}, "start_unknown is true and localizer 'ekf'"),
    ],
)
def test_conditions_that_cannot_be(condition: dict[str, Any], message: str) -> None:
    settings = [
        Setting(f"room, {name}", Venue("room", room(), None), name, arguments)
        for name, arguments in {"a": {}, "b": {"odometry": {"alpha1": 0.3}}, "c": condition}.items()
    ]
    methods = planner_methods([])[:1]
    assert len(fitting(small(room(), settings=settings[:2], methods=methods)).methods) == 1
    with pytest.raises(InputError, match=f"^suite 'room', condition 'c': {message}") as caught:
        fitting(small(room(), settings=settings, methods=methods))
    assert "\n" not in str(caught.value)


def test_planners_assume_the_odometry_of_the_condition(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assumed: list[Any] = []

    def plan(routes: Routes, buildings: Any, tasks: Any) -> list[None]:
        assumed.append((routes._odometry, routes._start_std))
        return [None] * len(tasks)

    monkeypatch.setattr(Routes, "plan", plan)
    place, start_std = Venue("room", room(), None), (0.1, 0.1, 0.1)
    settings = [Setting("a", place, "a", {}), Setting("b", place, "b", {"start_std": start_std})]
    methods, options = planner_methods([])[:1], OPTIONS | {"max_steps": 2}
    board = small(room(), settings=settings, methods=methods, options=options, episodes=1)
    board_module.run(board, tmp_path, lambda text: lambda share: None)
    expected = [board.parameters(setting, methods[0]) for setting in settings]
    assert assumed == [(item.odometry, item.start_std) for item in expected]
    assert assumed[1][1] == start_std != assumed[0][1]


@pytest.mark.parametrize(
    ("planners", "policies", "message"),
    [
        (["prmstr"], [], "prmstar"),
        (["reference:x"], [], "weight in 'reference:x' is none"),
        (["reference:-1"], [], "weight"),
        ([], ["gone.zip"], "no such file"),
        (["reference:2", "reference:2.0"], [], "two methods are called 'reference 2'"),
    ],
)
def test_bad_methods(planners: list[str], policies: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        all_methods(planners, policies)


def test_bad_options_and_folders(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="did you mean people"):
        benchmark(small(room(), options={"peple": 2}), tmp_path / "out")
    (tmp_path / "other.txt").touch()
    with pytest.raises(InputError, match=r"holds other\.txt"):
        benchmark(small(room()), tmp_path)
    assert not (tmp_path / "work").exists() and report_module.WORK == "work"
