"""A small frozen benchmark, and submissions to it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from ambinav.runtime.provenance import digest_of
from ambinav_envs.leaderboard.frozen import DEFINITION, FrozenBenchmark
from ambinav_envs.leaderboard.submission_checks import scores_of

PLAIN, HARD = "ambinav/Procedural-v1", "ambinav/AccurateGoal-v1"
SECRET = json.dumps({"seed": "5" * 64})
ATTACKS = """
import numpy as np


class Constant:
    def __init__(self, columns, still, declares):
        self.values = np.full(columns, 0.0)
        self.values[0], self.values[2:] = -1.0 if still else 1.0, 1.0 if declares else 0.0

    def act(self, observations, starts):
        return np.tile(self.values, (len(starts), 1))


class Random(Constant):
    def act(self, observations, starts):
        return np.random.default_rng(0).uniform(-1.0, 1.0, (len(starts), len(self.values)))


def make(kind, *arguments):
    return lambda observation, action: kind(action.shape[0], *arguments)


declares = make(Constant, True, True)
stands = make(Constant, True, False)
rams = make(Constant, False, False)
acts_randomly = make(Random, False, False)
"""


def ignore(text: str) -> Callable[[float], None]:
    """Draw no bar."""
    return lambda share: None


def small(folder: Path, **changes: Any) -> FrozenBenchmark:
    """The shipped benchmark with two tasks, of two buildings and two episodes each."""
    plain = yaml.safe_load(DEFINITION.read_text())
    plain["tasks"] = {name: plain["tasks"][name] for name in (PLAIN, HARD)}
    plain["buildings"] = {name: plain["buildings"][name][:2] for name in ("procedural", "hall")}
    plain |= {"episodes": 2, "commitment": hashlib.sha256(SECRET.encode()).hexdigest()}
    path = folder / "small.yaml"
    path.write_text(yaml.safe_dump(plain | changes, sort_keys=False))
    return FrozenBenchmark.read(path)


def written(record: dict[str, Any], path: Path, *, sealed: bool = True) -> Path:
    """The file of a submission; `sealed`: by someone who also corrects scores and digest."""
    if sealed:
        rest = {name: value for name, value in record.items() if name != "digest"}
        if rest["drawn"]["episodes"] is not None:
            rest["drawn"] |= scores_of(rest["drawn"]["episodes"])
        record = {**rest, "digest": digest_of(rest)}
    path.write_text(json.dumps(record))
    return path


def copied(record: dict[str, Any]) -> dict[str, Any]:
    return json.loads(json.dumps(record))  # type: ignore[no-any-return]
