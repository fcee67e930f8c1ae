"""What came of the episodes of `bench_ablation.py`, small enough to be kept with its results.

A file holds, for each run, place and condition, what the study reads of an episode, and what tells
episodes apart once for all runs. Figures that the study does not read are not kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ambinav.files import replacing
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
    """Who drove where."""

    run: str
    place: str
    condition: str


def keep(path: Path, driven: Mapping[Key, Episodes]) -> None:
    """Write episodes as .npz, whole or not at all.

    Raises:
        ValueError: two runs have other episodes at a place under a condition.
    """
    arrays: dict[str, Any] = {}
    for key, episodes in driven.items():
        for name in SHARED:
            shared = f"{key.place}/{key.condition}/{name}"
            value = getattr(episodes, name)
            if not np.array_equal(arrays.setdefault(shared, value), value):
                raise ValueError(f"{key}: {name} is not what the other runs have.")
        for name, kind in OF_RUNS.items():
            arrays["/".join((*key, name))] = getattr(episodes, name).astype(kind)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as fresh, fresh.open("wb") as file:
        np.savez_compressed(file, **arrays)


def kept(path: Path) -> dict[Key, Episodes]:
    """Read what `keep` wrote, nan where a figure is not kept; nothing if there is no such file."""
    found: dict[Key, Episodes] = {}
    if not path.is_file():
        return found
    with np.load(path) as stored:
        for name in stored:
            if not name.endswith("/outcome"):
                continue
            key = Key(*name.split("/")[:3])
            plain: dict[str, Any] = {
                field.name: np.full(len(stored[name]), np.nan) for field in fields(Episodes)
            }
            for one in SHARED:
                plain[one] = stored[f"{key.place}/{key.condition}/{one}"]
            for one in OF_RUNS:
                value = stored["/".join((*key, one))]
                plain[one] = value.astype(AS_DRIVEN[value.dtype.kind])
            found[key] = Episodes(**plain)
    return found
