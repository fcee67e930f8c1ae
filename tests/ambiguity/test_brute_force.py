"""The kernel against brute force, which compares the scans of a fine lattice as they stand."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.sensing import RangeScanner, RangeSensor
from benchmarks.brute_force import level

MEDIAN, PERCENTILE_95, MOST = 0.02, 0.03, 0.04
PLACES = 24


def cluttered(rng: np.random.Generator) -> Environment:
    """A hall of 12 x 9 m with thirty crates and posts, so that every scan has many edges."""
    crates = []
    for x, y, size, turn in rng.uniform((1, 1, 0.06, 0), (11, 8, 0.5, math.pi), (30, 4)):
        box = shapely.box(x - size, y - 0.6 * size, x + size, y + 0.6 * size)
        crates.append(shapely.affinity.rotate(box, turn, use_radians=True))
    free = shapely.difference(shapely.box(0, 0, 12, 9), shapely.union_all(crates))
    return environment_from_shapes(list(shapely.get_parts(free)))


@pytest.mark.slow(kept=("4.0-0.03",))
@pytest.mark.parametrize(("reach", "std"), [(4.0, 0.03), (30.0, 0.01)])
def test_in_clutter(reach: float, std: float) -> None:
    rng = np.random.default_rng(3)
    env = cluttered(rng)
    scanner = RangeScanner.planar(
        sensor=RangeSensor(max_range=reach, std=std, resolution=0.001), beams=60, aperture=math.tau
    )
    amap = build_map(env, scanner)
    model = json.loads(amap.dataset.attrs["parameters"])
    cells = rng.permutation(np.argwhere(amap.dataset["clearance"].values >= 0.3))[:PLACES]
    off = []
    for row, column in cells:
        x, y = float(amap.dataset["x"][column]), float(amap.dataset["y"][row])
        true = level(env, scanner, x, y, map_std=model["map_std"], tau=model["tau"])
        off.append(float(amap.dataset["level"].values[row, column]) - true)
    size = np.abs(off)
    print(f"{np.median(size):.4f} {np.percentile(size, 95):.4f} {min(off):+.4f} {max(off):+.4f}")
    assert np.median(size) < MEDIAN
    assert np.percentile(size, 95) < PERCENTILE_95
    assert size.max() < MOST
