"""Small buildings and scanners for maps in tiles, and how two stores are compared."""

from __future__ import annotations

import functools
import hashlib
import math
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import ambinav as an
from ambinav.map_building.build import MapSettings
from ambinav.tiles.job import tile_variables
from ambinav.tiles.plan import TilePlan

DEMO = Path(an.__file__).parent / "demo" / "demo.geojson"
LASER = an.RangeSensor(max_range=3.0, std=0.03, resolution=0.001)
AROUND = an.RangeScanner.planar(LASER, 16, 2 * math.pi)
OFF_CENTRE = an.RangeScanner.planar(LASER, 12, math.pi, mount=(0.2, 0.1, 0.3))
CASES: Mapping[str, tuple[an.RangeScanner, Mapping[str, Any]]] = {
    "around": (AROUND, {}),
    "headings and a body": (OFF_CENTRE, {"headings": 3, "robot_radius": 0.2}),
    "sonar and laser": (an.RangeScanner.from_preset("pioneer-sonar-laser"), {"headings": 2}),
}


@functools.cache
def demo() -> an.Environment:
    return an.load_environment(DEMO)


def plan(env: an.Environment, tile: float, case: str = "around", spacing: float = 0.5) -> TilePlan:
    scanner, options = CASES[case]
    return TilePlan.of(env, MapSettings.of(env, scanner, spacing, 0.6, **options), tile)


def whole(env: an.Environment, case: str = "around", spacing: float = 0.5) -> an.AmbiguityMap:
    scanner, options = CASES[case]
    return an.build_map(env, scanner, spacing, 0.6, store=False, **options)


def content(folder: Path) -> dict[str, str]:
    """Checksum of every file, but of those that say when a map was made."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and path != folder / "zarr.json"
    }


def assert_identical(one: an.AmbiguityMap, other: an.AmbiguityMap) -> None:
    """All variables and attributes, to the last bit, but when they were made."""
    first, second = (amap.dataset.assign_attrs(created="") for amap in (one, other))
    assert first.attrs == second.attrs
    assert set(first.variables) == set(second.variables)
    for name, values in first.variables.items():
        found = second.variables[name]
        assert (values.dims, values.dtype, values.attrs) == (found.dims, found.dtype, found.attrs)
        np.testing.assert_array_equal(values.values, found.values, err_msg=str(name))
    assert first.identical(second)


def assert_tiles(amap: an.AmbiguityMap, made: TilePlan, rng: np.random.Generator) -> None:
    """All tiles, in some order, each made of nothing but what is sent, are those of the map."""
    layers = {n: v.values for n, v in amap.dataset.items() if v.dims[:2] == ("y", "x")}
    del layers["judged"]  # no tile knows what a robot reaches
    tiles = list(made.tiles())
    assert sum(math.prod(tile.shape) for tile in tiles) == layers["free"].size
    for k in rng.permutation(len(tiles)):
        found = tile_variables(made.job, pickle.loads(pickle.dumps(made.input(tiles[k]))))
        assert len(found) == 1 or set(found) == set(layers)
        for name, values in layers.items():
            expected = values[tiles[k].window]
            if name in found:
                assert found[name].dtype == expected.dtype
                np.testing.assert_array_equal(found[name].values, expected, err_msg=name)
            elif expected.dtype.kind == "f":
                assert np.isnan(expected).all()
        if len(found) == 1:
            assert not layers["free"][tiles[k].window].any()
