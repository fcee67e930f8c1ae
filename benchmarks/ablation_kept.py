"""Results of the episodes of `bench_ablation.py`, small enough to be stored with its report.

A file holds, for each run, place and condition, what the study reads of an episode, and what tells
episodes apart once for all runs. Figures that the study does not read are not kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ambinav.runtime.files import replacing
from ambinav_envs.evaluation import Episodes

OF_RUNS: Final[dict[str, type]] = {
    "outcome": np.int8,
    "was_lost": np.bool_,
    "travelled": np.float32,
    "exposure": np.float32,
}
AS_DRIVEN: Final[dict[str, type]] = {"b": np.bool_, "f": np.float64, "i": np.int64}
"""By the kind of what is kept."""
SHARED: Final = ("shortest", "building", "seed")
"""The same whoever drives."""


class Key(NamedTuple):
    """Run, building and condition of some episodes."""

    run: str
    place: str
    condition: str


def keep(path: Path, driven: Mapping[Key, Episodes]) -> None:
    """Write episodes as .npz atomically; all runs have driven everywhere.

    Raises:
        ValueError: two runs have other episodes at a place under a condition.
    """
    runs = list(dict.fromkeys(key.run for key in driven))
    arrays: dict[str, Any] = {"runs": np.array(runs)}
    for place, condition in dict.fromkeys((key.place, key.condition) for key in driven):
        by_run = [driven[Key(run, place, condition)] for run in runs]
        for name in SHARED:
            first = getattr(by_run[0], name)
            if not all(
                np.array_equal(getattr(episodes_of_run, name), first) for episodes_of_run in by_run
            ):
                raise ValueError(f"{place}, {condition}: {name} is not the same in all runs.")
            arrays[f"{place}/{condition}/{name}"] = first
        for name, kind in OF_RUNS.items():
            values = np.stack([getattr(episodes_of_run, name) for episodes_of_run in by_run])
            arrays[f"{place}/{condition}/{name}"] = values.astype(kind)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, **arrays)


def kept(path: Path) -> dict[Key, Episodes]:
    """Read the output of `keep`, nan for figures that are not stored; empty without a file."""
    episodes_by_key: dict[Key, Episodes] = {}
    if not path.is_file():
        return episodes_by_key
    with np.load(path) as file:
        stored = {name: file[name] for name in file}
    for where in dict.fromkeys(name.rpartition("/")[0] for name in stored if "/" in name):
        place, condition = where.split("/")
        shared = {name: stored[f"{where}/{name}"] for name in SHARED}
        nothing = np.full(len(shared["seed"]), np.nan)
        for row, run in enumerate(stored["runs"].tolist()):
            plain: dict[str, Any] = {field.name: nothing for field in fields(Episodes)} | shared
            for name in OF_RUNS:
                value = stored[f"{where}/{name}"][row]
                plain[name] = value.astype(AS_DRIVEN[value.dtype.kind])
            episodes_by_key[Key(run, place, condition)] = Episodes(**plain)
    return episodes_by_key
