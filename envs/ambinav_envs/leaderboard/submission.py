"""Submissions to the frozen benchmark: policies and results in one file, which can be run again."""

from __future__ import annotations

import base64
import json
import platform
import tempfile
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

from ambinav.config import nearest
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.progress import Stages
from ambinav.runtime.provenance import Provenance, digest_of
from ambinav_envs.leaderboard.frozen import RECORDED, FrozenBenchmark, drive
from ambinav_envs.leaderboard.methods import Method, policy_method
from ambinav_envs.leaderboard.store import computed_by
from ambinav_envs.leaderboard.submission_checks import (
    Record,
    contradictions,
    first_difference,
    is_complete,
    scores_of,
)
from ambinav_envs.policies.archive import MEBIBYTE

FORMAT: Final = 1
EMBEDDED: Final = 16 * MEBIBYTE
"""Policy files of at most so many bytes are part of the submission."""


@dataclass(frozen=True, eq=False)
class Entry:
    """A policy of a submission.

    Attributes:
        tasks: The tasks in which it drives.
        method: The method.
        kind: One of `submission_checks.KINDS`.
        checksum: SHA-256 of its file or code, or `ReactivePolicy.checksum`.
        content: The file in base64 if it is to be part of the submission.
    """

    tasks: Sequence[str]
    method: Method
    kind: str
    checksum: str
    content: str | None = None

    @classmethod
    def of(cls, tasks: Sequence[str], source: str, trust: bool = False) -> Entry:
        """Load a policy.

        Raises:
            InputError: see `load_policy`.
        """
        method, content = policy_method(source, trust=trust), None
        kind, checksum = next(iter(method.identity)), [*method.identity.values()][-1]
        if kind == "file" and Path(source).stat().st_size <= EMBEDDED:
            content = base64.b64encode(Path(source).read_bytes()).decode()
        return cls(tasks, method, kind, checksum, content)

    def to_plain(self) -> Record:
        """Return the entry for JSON."""
        return {
            "name": self.method.name, "kind": self.kind, "tasks": self.tasks,
            "sha256": self.checksum, "file": self.content,
            "complete": is_complete(self.kind, self.content),
        }  # fmt: skip


def entries_for(frozen: FrozenBenchmark, policies: Sequence[str], trust: bool) -> list[Entry]:
    """Load the policies that a user names.

    Args:
        frozen: The benchmark.
        policies: Values that `load_policy` takes, for all tasks, or TASK=POLICY for one of them;
            or a submission (.json) alone, whose policies are taken.
        trust: See `load_policy`.

    Raises:
        InputError: a task has no policy or two, or see `load_policy` and `read_submission`.
    """
    if len(policies) == 1 and policies[0].endswith(".json"):
        return _entries_in(read_submission(Path(policies[0]), frozen), (), trust)
    by_task = [text.split("=", 1) for text in policies if text.partition("=")[0] in frozen.tasks]
    common = [text for text in policies if text.partition("=")[0] not in frozen.tasks]
    for text in (text for text in common if "=" in text and not Path(text).exists()):
        task = text.partition("=")[0]
        raise InputError(
            f"--policy {text}: {task!r} is no task of the benchmark; {nearest(task, frozen.tasks)}."
        )
    chosen = {**dict.fromkeys(frozen.tasks, common[0] if common else ""), **dict(by_task)}
    if len(common) > 1 or len(dict(by_task)) < len(by_task) or "" in chosen.values():
        raise InputError(
            "--policy: a task has two policies or none; give one for all, and TASK=POLICY for "
            f"others, with {', '.join(frozen.tasks)}."
        )
    return [
        Entry.of([task for task in chosen if chosen[task] == source], source, trust)
        for source in dict.fromkeys(chosen.values())
    ]


def make_record(
    frozen: FrozenBenchmark,
    entries: Sequence[Entry],
    begin: Stages,
    secret: Path | None = None,
    maps: Path | None = None,
    quick: bool = False,
) -> Record:
    """Drive the benchmark and return the submission.

    Args:
        frozen: The benchmark.
        entries: Its policies.
        begin: Given a text, returns what takes the share done.
        secret: File with the hidden seed, in place of the public one. No episodes are in the
            submission then: a score gives away how far the goal is, which leads to start and goal.
        maps: Folder of the recorded maps; None: without them.
        quick: Drive only a few episodes.

    Raises:
        InputError: a policy does not fit, or is code that could read the hidden seed; or see
            `drive` and `FrozenBenchmark.hidden_seed`.
    """
    seed = frozen.seed if secret is None else frozen.hidden_seed(secret)
    for entry in entries:
        if secret is not None and entry.kind == "callable":
            raise InputError(
                f"--secret: policy {entry.method.name!r} is code, which could read the hidden "
                "seed; give a policy file."
            )
    methods = {task: entry.method for entry in entries for task in entry.tasks}
    wall, processor = time.perf_counter(), time.process_time()
    driven = drive(frozen.quick() if quick else frozen, methods, seed, maps, begin)
    record = {
        "format": FORMAT, "benchmark": frozen.version, "definition": frozen.digest, "quick": quick,
        "seeds": "public" if secret is None else "hidden",
        "policies": [entry.to_plain() for entry in entries],
        **{part: {**scores_of(tasks), "episodes": tasks if secret is None else None}
           for part, tasks in driven.items()},
        "computed_by": asdict(computed_by()),
        "machine": f"{platform.platform()}, Python {platform.python_version()}",
        "wall_seconds": round(time.perf_counter() - wall, 1),
        "processor_seconds": round(time.process_time() - processor, 1),
    }  # fmt: skip
    record = json.loads(json.dumps(record))
    return {**record, "digest": digest_of(record)}


def read_submission(path: Path, frozen: FrozenBenchmark) -> Record:
    """Read a submission and check what can be checked without driving.

    Raises:
        InputError: it is none, of another version or of a quick trial, or it has been changed.

    Warns:
        InputWarning: other code or libraries computed it.
    """
    try:
        record: Record = json.loads(path.read_text(encoding="utf-8"))
        if (record["format"], record["definition"]) != (FORMAT, frozen.digest):
            raise InputError(
                f"{path}: it is not of the benchmark v{frozen.version} here; use the ambinav that "
                "wrote it."
            )
        if record["quick"]:
            raise InputError(
                f"{path}: it is a quick trial and no submission; submit without --quick."
            )
        for name in contradictions(record, frozen):
            raise InputError(f"{path}: {name}, so the file was changed.")
        reason = computed_by().difference(Provenance(**record["computed_by"]))
    except InputError:
        raise
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror}).") from error
    except json.JSONDecodeError as error:
        raise InputError(
            f"{path}, line {error.lineno}: this is not valid JSON; get the file again."
        ) from error
    except (ValueError, LookupError, TypeError, AttributeError) as error:
        lacks = f"{error.args[0]} is missing" if isinstance(error, KeyError) else str(error)
        raise InputError(
            f"{path}: this is not a submission ({lacks}); give a file that `ambinav benchmark "
            "--submit` wrote."
        ) from error
    if reason is not None:
        warnings.warn(f"{path} was computed by {reason}.", InputWarning, stacklevel=2)
    return record


def verify(
    path: Path,
    frozen: FrozenBenchmark,
    begin: Stages,
    policies: Sequence[str] = (),
    trust: bool = False,
    secret: Path | None = None,
    maps: Path | None = None,
) -> tuple[Record, str | None]:
    """Drive a submission again; return it, and a sentence on the first difference if there is one.

    Args:
        path: The submission.
        frozen: The benchmark.
        begin: Given a text, returns what takes the share done.
        policies: Policies that are not part of the submission.
        trust: See `load_policy`.
        secret: See `make_record`.
        maps: See `make_record`.

    Raises:
        InputError: see `read_submission` and `make_record`; or something is lacking or too much.
    """
    record = read_submission(path, frozen)
    for option, is_given, is_needed in (
        ("--secret", secret is not None, record["seeds"] == "hidden"),
        ("--recorded", maps is not None, RECORDED in record),
    ):
        if is_given is not is_needed:
            how = f"with {option}; give it too" if is_needed else f"without {option}; leave it out"
            raise InputError(f"{path}: it was made {how}.")
    entries = _entries_in(record, policies, trust)
    rerun = make_record(frozen, entries, begin, secret, maps)
    return record, first_difference(record, rerun)


def _entries_in(record: Record, policies: Sequence[str], trust: bool) -> list[Entry]:
    """Load the policies of a submission; those that it does not contain are among `policies`."""
    entries = []
    unmatched = {entry.checksum: entry for entry in (Entry.of((), p, trust) for p in policies)}
    for policy in record["policies"]:
        tasks, name, checksum = policy["tasks"], policy["name"], policy["sha256"]
        if policy["kind"] == "reactive":
            entries.append(Entry.of(tasks, name))
        elif policy["file"] is not None:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "policy.zip"
                path.write_bytes(base64.b64decode(policy["file"]))
                entry = Entry.of(tasks, str(path))
            entries.append(replace(entry, method=replace(entry.method, name=name)))
        elif checksum in unmatched:
            entries.append(replace(unmatched.pop(checksum), tasks=tasks))
        else:
            raise InputError(
                f"policy {name!r} is not part of the submission; give it with --policy "
                f"(SHA-256 {checksum[:12]}...)."
            )
    if unmatched:
        raise InputError("--policy: the submission has no such policy; leave it out.")
    return entries
