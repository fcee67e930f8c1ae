"""A small building, a scanner, and processes that build its map."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import shapely

import ambinav as an
from ambinav.store.map_store import TAG, MapStore

ROOT = Path(__file__).parents[2]
PATHS = os.pathsep.join(str(ROOT / name) for name in ("", "envs", "planners"))
"""All packages, since the code of all of them is part of a map's key."""


def room(width: float = 4.0, **named: object) -> an.Environment:
    floor = [shapely.box(0, 0, width, 3)]
    env = an.environment_from_shapes(floor)
    for name, value in named.items():
        setattr(env, name, value)
    return env


def laser(beams: int = 24) -> an.RangeScanner:
    sensor = an.RangeSensor(max_range=2.0, std=0.02, resolution=0.01)
    return an.RangeScanner.planar(sensor=sensor, beams=beams, aperture=math.tau)


def build(store: bool | MapStore, env: an.Environment | None = None, **options) -> an.AmbiguityMap:
    return an.build_map(env or room(), laser(), **({"spacing": 0.25} | options), store=store)


def python(code: str, *words: str) -> subprocess.Popen[str]:
    """A process that runs some code; whoever starts it ends it."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *words],
        env={**os.environ, "PYTHONPATH": PATHS},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def names(store: MapStore) -> list[str]:
    """What the store has in its folder, but for its tag."""
    return sorted(path.name for path in store.place.iterdir() if path.name != TAG)


def same(one: an.AmbiguityMap, other: an.AmbiguityMap) -> bool:
    """Bit for bit, but for the time at which it was made."""
    made = {"created": ""}
    first, second = one.dataset.assign_attrs(made), other.dataset.assign_attrs(made)
    return first.identical(second) and all(
        first[name].values.tobytes() == second[name].values.tobytes()
        and first[name].dtype == second[name].dtype
        for name in first.variables
    )
