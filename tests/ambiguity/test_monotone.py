"""More precision, more beams and more range never make a building more ambiguous.

On a drawn warehouse and on all recorded maps: along each sweep the mean `level` may rise above the
least value so far by at most `MOST_RISE`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from ambinav.ambiguity.indistinguishability import FINEST_STD, STATED_STD, most_evidence
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.sensing import RangeScanner, RangeSensor
from tests import recorded
from tests.ambiguity.test_mounts import piece

MOST_RISE = 0.01
SWEEPS: dict[str, tuple[float, ...]] = {
    "map_std": (0.1, 0.05, 0.03, 0.02, 0.015, 0.01, 0.005, 0.002, 0.001, 0.0),
    "std": (0.1, 0.05, 0.02, 0.005, 0.001),
    "resolution": (0.2, 0.1, 0.05, 0.01, 0.001),
    "beams": (10, 15, 20, 30, 45, 60, 90, 180),
    "max_range": (1.5, 2, 3, 4, 6, 9, 14, 30),
}
NOISELESS = {"std": 0.0, "resolution": 1e-6, "map_std": 0.0}


def levels(env: Environment, spacing: float = 0.25, **changed: Any) -> np.ndarray:
    """Return `level` at the free poses for a sharp laser (60 beams, 4 m), some settings changed."""
    known: dict[str, Any] = {
        "max_range": 4.0,
        "std": 1e-3,
        "resolution": 1e-3,
        "beams": 60,
        "map_std": 0.02,
    }
    known |= changed
    map_std, beams = float(known.pop("map_std")), int(known.pop("beams"))
    scanner = RangeScanner.planar(RangeSensor(**known), beams, 2 * math.pi)
    amap = build_map(env, scanner, spacing, map_std=map_std, store=False)
    return np.asarray(amap.dataset["level"].values[amap.dataset["free"].values], dtype=float)


def hold(env: Environment, spacing: float = 0.25) -> None:
    for setting, values in SWEEPS.items():
        mean = np.array([levels(env, spacing, **{setting: value}).mean() for value in values])
        rise = mean - np.minimum.accumulate(mean)
        print(f"{env.name} {setting} {np.round(mean, 3)}")
        assert rise.max() <= MOST_RISE, f"{env.name}, {setting}: {np.round(mean, 4)}"
    assert np.isfinite(levels(env, spacing, **NOISELESS)).all()


def warehouse() -> Environment:
    """Five long racks in a hall, wider apart than half of the laser's range."""
    racks = [shapely.box(6.0, 3.0 + 4.2 * k, 34.0, 4.2 + 4.2 * k) for k in range(5)]
    hall = shapely.box(0.0, 0.0, 40.0, 26.0)
    return environment_from_shapes([hall.difference(shapely.union_all(racks))], name="warehouse")


@pytest.mark.sweep
def test_warehouse() -> None:
    hold(warehouse(), spacing=0.4)


def test_the_cap_of_a_beam() -> None:
    """As stated down to 2 cm, then by the fourth power of the deviation, and finite without any."""
    assert most_evidence(0.05, 0.5) == most_evidence(0.05, STATED_STD) == -math.log(0.05)
    halved = most_evidence(0.05, STATED_STD / 2)
    assert math.exp(-halved) == pytest.approx(0.05 / 2**4)
    assert most_evidence(0.05, 0.0) == most_evidence(0.05, FINEST_STD)


@pytest.mark.slow(kept=("3",))
@pytest.mark.parametrize("part", range(16))
def test_all_maps(data_dir: Path, part: int) -> None:
    for file in recorded.all_maps(data_dir)[part::16]:
        hold(piece(recorded.read(file)[0]), spacing=0.4)
