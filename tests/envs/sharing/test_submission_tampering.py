"""Submissions that somebody changed are refused."""

from __future__ import annotations

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("gymnasium")

from ambinav.runtime.errors import InputError
from ambinav.runtime.provenance import digest_of
from ambinav_envs.leaderboard.frozen import FrozenBenchmark
from ambinav_envs.leaderboard.submission import read_submission
from tests.envs.sharing.submissions import HARD, PLAIN, copied, written


def _other_outcome(record: dict[str, Any]) -> None:
    record["drawn"]["episodes"][PLAIN][0][2] = "arrived"


def _other_score(record: dict[str, Any]) -> None:
    record["drawn"]["score"]["value"] = 0.9


def _other_weights(record: dict[str, Any]) -> None:
    content = bytearray(base64.b64decode(record["policies"][0]["file"]))
    content[-100] ^= 1
    record["policies"][0]["file"] = base64.b64encode(content).decode()


def _no_file(record: dict[str, Any]) -> None:
    record["policies"][0]["file"] = "###"


def _other_seeds(record: dict[str, Any]) -> None:
    record["seeds"] = "mine"


def _no_policy(record: dict[str, Any]) -> None:
    record["policies"].pop()


def _quick(record: dict[str, Any]) -> None:
    record["quick"] = True


def _other_version(record: dict[str, Any]) -> None:
    record["definition"] = "0" * 64


def _no_tasks(record: dict[str, Any]) -> None:
    del record["policies"][0]["tasks"]


def _other_field(record: dict[str, Any]) -> None:
    record["note"] = "best of all"


def _field_of_a_policy(record: dict[str, Any]) -> None:
    record["policies"][0]["note"] = "best of all"


def _field_of_results(record: dict[str, Any]) -> None:
    record["drawn"]["note"] = "best of all"


def _complete(record: dict[str, Any]) -> None:
    record["policies"][0] |= {"kind": "callable", "file": None}


def _kind(record: dict[str, Any]) -> None:
    record["policies"][1]["kind"] = "magic"


def _without_episodes(record: dict[str, Any]) -> None:
    record["drawn"]["episodes"] = None


def _said_to_be_hidden(record: dict[str, Any]) -> None:
    record["seeds"] = "hidden"


def _without_a_task(record: dict[str, Any]) -> None:
    del record["drawn"]["tasks"][HARD], record["drawn"]["episodes"][HARD]


def _half_of_them(record: dict[str, Any]) -> None:
    del record["drawn"]["episodes"][HARD][2:]


def _the_best_twice(record: dict[str, Any]) -> None:
    rows = record["drawn"]["episodes"][HARD]
    rows[:] = rows[:2] * 2


def _own_seed(record: dict[str, Any]) -> None:
    record["drawn"]["episodes"][HARD][1][1] += 1


def _more_than_all(record: dict[str, Any]) -> None:
    record["drawn"]["episodes"][HARD][1][2:] = ["arrived", 1.0, 1.5]


def _no_number(record: dict[str, Any]) -> None:
    record["drawn"]["episodes"][HARD][1][4] = float("nan")


@pytest.mark.parametrize(
    ("change", "sealed", "message"),
    [
        (_other_field, True, "'note' is no field of a submission, so the file was changed"),
        (_field_of_a_policy, True, "'note' is no field of policy 'mine'"),
        (_field_of_results, True, "drawn: 'note' is no field of results"),
        (_complete, True, "complete of policy 'mine' contradicts the rest"),
        (_kind, True, "kind of policy 'vfh' contradicts the rest"),
        (_without_episodes, True, "drawn: episodes contradicts seeds"),
        (_said_to_be_hidden, True, "drawn: episodes contradicts seeds"),
        (_without_a_task, True, "drawn: task ambinav/AccurateGoal-v1 is missing"),
        (_half_of_them, True, "the 2 episodes of ambinav/AccurateGoal-v1 are not the 4 of"),
        (_the_best_twice, True, "the 4 episodes of ambinav/AccurateGoal-v1 are not the 4 of"),
        (_own_seed, True, "the 4 episodes of ambinav/AccurateGoal-v1 are not the 4 of"),
        (_more_than_all, True, "cannot be: hall-1000, seed .*: arrived after 1 s with score 1.5"),
        (_no_number, True, "an episode of ambinav/AccurateGoal-v1 cannot be"),
        (_other_outcome, False, "digest contradicts the rest"),
        (_other_score, False, "digest contradicts the rest"),
        (_other_weights, True, "the file of policy 'mine' contradicts the rest"),
        (_no_file, True, "the file of policy 'mine' contradicts the rest"),
        (_other_seeds, True, "seeds contradicts the rest"),
        (_no_policy, True, "policies contradicts the rest"),
        (_quick, True, "it is a quick trial and no submission"),
        (_other_version, True, "it is not of the benchmark v1 here"),
        (_no_tasks, True, r"this is not a submission \(tasks is missing\); give a file that"),
    ],
)
def test_changes_are_refused(
    change: Callable[[dict[str, Any]], None],
    sealed: bool,
    message: str,
    record: dict[str, Any],
    frozen: FrozenBenchmark,
    tmp_path: Path,
) -> None:
    changed = copied(record)
    change(changed)
    with pytest.raises(InputError, match=message):
        read_submission(written(changed, tmp_path / "changed.json", sealed=sealed), frozen)


def test_what_is_cut_off_is_refused(frozen: FrozenBenchmark, tmp_path: Path) -> None:
    (tmp_path / "cut.json").write_text('{"format": 1,\n"quick": fal')
    with pytest.raises(InputError, match=r"cut\.json, line 2: this is not valid JSON"):
        read_submission(tmp_path / "cut.json", frozen)


def test_a_score_that_its_episodes_do_not_give_is_refused(
    record: dict[str, Any], frozen: FrozenBenchmark, tmp_path: Path
) -> None:
    changed = copied(record)
    _other_score(changed)
    rest = {name: value for name, value in changed.items() if name != "digest"}
    path = written({**rest, "digest": digest_of(rest)}, tmp_path / "changed.json", sealed=False)
    with pytest.raises(InputError, match="drawn: score contradicts"):
        read_submission(path, frozen)
