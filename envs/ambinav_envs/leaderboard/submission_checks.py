"""Scores of submissions to the frozen benchmark, and checks of all that a submission says."""

from __future__ import annotations

import base64
import binascii
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np

from ambinav.drive.bootstrap import percentiles
from ambinav.runtime.provenance import digest_of
from ambinav_envs.leaderboard.figures import draws, plain
from ambinav_envs.leaderboard.frozen import DRAWN, PARTS, FrozenBenchmark, Outcome
from ambinav_envs.simulation.layout import ARRIVED, OUTCOMES, TIMEOUT

KINDS: Final = ("reactive", "file", "callable")
_FIELDS: Final = (
    "format", "benchmark", "definition", "quick", "seeds", "policies", "computed_by", "machine",
    "wall_seconds", "processor_seconds", "digest",
)  # fmt: skip
"""Fields of a submission beside the parts."""
_OF_A_POLICY: Final = ("name", "kind", "tasks", "sha256", "file", "complete")

Record = dict[str, Any]


def is_complete(kind: str, content: str | None) -> bool:
    """Return whether a policy can be driven from the submission alone."""
    return kind == "reactive" or content is not None


def scores_of(tasks: Mapping[str, Sequence[Sequence[Any]]]) -> Record:
    """Return the score of all tasks and of each, with intervals over buildings, and the outcomes.

    Args:
        tasks: The fields of each `Outcome`, by task.
    """
    scores, means, drawn = {}, [], []
    for task, rows in tasks.items():
        outcomes = [Outcome(*row) for row in rows]
        score = np.array([outcome.score for outcome in outcomes])
        building = np.array([outcome.building for outcome in outcomes])
        # Tasks in the same buildings have the same draws of them.
        weights = np.concatenate([*draws(str(building[0]).rpartition("-")[0], building, 0)])
        means.append(float(np.mean(score)))
        drawn.append(weights @ score / len(score))
        ended = [outcome.ended for outcome in outcomes]
        scores[task] = {
            **(plain(percentiles(means[-1], drawn[-1], len(score))) or {}),
            **{name: ended.count(name) for name in OUTCOMES[ARRIVED : TIMEOUT + 1]},
        }
    total = percentiles(float(np.mean(means)), np.mean(drawn, axis=0), len(means))
    return {"score": plain(total), "tasks": scores}


def contradictions(record: Record, frozen: FrozenBenchmark) -> Iterator[str]:
    """Yield what of a submission does not fit the rest, or the benchmark."""
    signed = {name: value for name, value in record.items() if name != "digest"}
    if record["digest"] != digest_of(signed):
        yield "digest contradicts the rest"
    for name in (name for name in record if name not in (*_FIELDS, *PARTS)):
        yield f"{name!r} is no field of a submission"
    if record["benchmark"] != frozen.version:
        yield "benchmark contradicts the rest"
    if record["seeds"] not in ("public", "hidden"):
        yield "seeds contradicts the rest"
    if sorted(t for policy in record["policies"] for t in policy["tasks"]) != sorted(frozen.tasks):
        yield "policies contradicts the rest"
    for policy in record["policies"]:
        name, kind, content = policy["name"], policy["kind"], policy["file"]
        for key in (key for key in policy if key not in _OF_A_POLICY):
            yield f"{key!r} is no field of policy {name!r}"
        if content is not None and _sha256_of(content) != policy["sha256"]:
            yield f"the file of policy {name!r} contradicts the rest"
        if kind not in KINDS or (content is not None and kind != "file"):
            yield f"kind of policy {name!r} contradicts the rest"
        if policy["complete"] is not is_complete(kind, content):
            yield f"complete of policy {name!r} contradicts the rest"
    for part in (part for part in PARTS if part == DRAWN or part in record):
        for text in _contradictions_in(part, record, frozen):
            yield f"{part}: {text}"


def _contradictions_in(part: str, record: Record, frozen: FrozenBenchmark) -> Iterator[str]:
    """Yield what of the results in one part contradicts the rest."""
    results, public = record[part], record["seeds"] == "public"
    episodes = results["episodes"]
    for name in (name for name in results if name not in ("score", "tasks", "episodes")):
        yield f"{name!r} is no field of results"
    if isinstance(episodes, dict) is not public:
        yield "episodes contradicts seeds"
        return
    for tasks in (results["tasks"], *([episodes] if public else [])):
        for task in (task for task in frozen.tasks if task not in tasks):
            yield f"task {task} is missing"
            return
        if sorted(tasks) != sorted(frozen.tasks):
            yield "a task is not of the benchmark"
            return
    if not public:
        return
    for task, rows in episodes.items():
        outcomes = [Outcome(*row) for row in rows]
        fixed = frozen.episodes_of(part, task)
        if [(outcome.building, outcome.seed) for outcome in outcomes] != fixed:
            yield f"the {len(rows)} episodes of {task} are not the {len(fixed)} of the benchmark"
            return
        for outcome in outcomes:
            ends = OUTCOMES[ARRIVED : TIMEOUT + 1]
            possible = 0.0 <= outcome.score <= float(outcome.ended == OUTCOMES[ARRIVED])
            if outcome.ended not in ends or not possible or not 0.0 <= outcome.seconds < np.inf:
                yield f"an episode of {task} cannot be: {_text(outcome)}"
                return
    if results != {**scores_of(episodes), "episodes": episodes}:
        yield "score contradicts the rest"


def first_difference(record: Record, rerun: Record) -> str | None:
    """Return a sentence that names the first field whose value is another one here."""
    for policy, fresh_row in zip(record["policies"], rerun["policies"], strict=True):
        # The name of a file is anybody's choice, and a large file is known by its digest.
        for name in ("kind", "sha256"):
            if policy[name] != fresh_row[name]:
                return (
                    f"policy {policy['name']!r}: {name} is {policy[name]} in the file, but "
                    f"{fresh_row[name]} here."
                )
    for part in (part for part in PARTS if record.get(part) != rerun.get(part)):
        for task, rows in (record[part]["episodes"] or {}).items():
            for row, fresh_row in zip(rows, rerun[part]["episodes"][task], strict=True):
                if row != fresh_row:
                    return f"{task}, {_difference(Outcome(*row), Outcome(*fresh_row))}"
        for task, scores in record[part]["tasks"].items():
            fresh_row = rerun[part]["tasks"][task]
            for name in (name for name in scores if scores[name] != fresh_row.get(name)):
                stored, fresh = scores[name], fresh_row.get(name)
                return f"{part}, {task}: {name} is {stored} in the file, but {fresh} here."
        for name, value in record[part]["score"].items():
            fresh_row = rerun[part]["score"][name]
            if value != fresh_row:
                return f"{part}: {name} of the score is {value} in the file, but {fresh_row} here."
    return None


def _difference(row: Outcome, fresh: Outcome) -> str:
    names = [name for name in Outcome._fields if getattr(row, name) != getattr(fresh, name)]
    return (
        f"{row.building}, seed {row.seed}: {_end(row)} in the file, but {_end(fresh)} here "
        f"({', '.join(names)} differ)."
    )


def _end(row: Outcome) -> str:
    return f"{row.ended} after {row.seconds:g} s with score {row.score:.9g}"


def _text(row: Outcome) -> str:
    return f"{row.building}, seed {row.seed}: {_end(row)}"


def _sha256_of(encoded: str) -> str | None:
    """Return the SHA-256 of a file in base64; None where it cannot be decoded."""
    try:
        return hashlib.sha256(base64.b64decode(encoded, validate=True)).hexdigest()
    except binascii.Error:
        return None
