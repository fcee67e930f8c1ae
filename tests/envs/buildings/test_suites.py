from __future__ import annotations

import hashlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.geometry.segments import FRONTIER
from ambinav_envs.buildings.procedural import ROBOT
from ambinav_envs.buildings.suites import (
    Suite,
    _suites,
    register_suite,
    suite,
    suite_names,
)

NAMES = ("hall", "corridor", "office", "warehouse", "loop", "procedural")
VARIANTS = (*range(8), 1000, 2**31 - 1)

DIGEST = """
import hashlib, sys
from ambinav_envs.buildings.suites import suite
for name in sys.argv[1:]:
    for variant in (0, 5):
        print(hashlib.sha256(suite(name).building(variant).segments.xy.tobytes()).hexdigest())
"""


def test_there_are_six() -> None:
    assert suite_names() == NAMES
    assert all(suite(name).title for name in NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_the_robot_gets_everywhere(name: str) -> None:
    for variant in VARIANTS:
        building = suite(name).building(variant)
        assert building.name == f"{name}-{variant}"
        # One floor, walled all round, with one part where a large robot's centre can be.
        assert isinstance(building.free, shapely.Polygon)
        assert not (building.segments.kind == FRONTIER).any()
        inner = building.free.buffer(-ROBOT)
        assert isinstance(inner, shapely.Polygon), f"{building.name} falls apart"
        # No hair of free space between a thing and a wall.
        assert building.free.area - building.free.buffer(-0.02).buffer(0.03).area < 0.01
        xmin, ymin, xmax, ymax = building.bounds
        assert max(xmax - xmin, ymax - ymin) < 36.0
        assert 80.0 < building.free.area < 500.0
        # A robot of the usual size can stand on most of the floor.
        assert building.free.buffer(-0.27).area > 0.55 * building.free.area


@pytest.mark.parametrize("name", NAMES)
def test_buildings_of_a_suite_differ(name: str) -> None:
    shapes = [suite(name).building(variant).segments.xy.tobytes() for variant in range(8)]
    assert len({hashlib.sha256(shape).digest() for shape in shapes}) == 8
    again = suite(name).building(3).segments.xy.tobytes()
    assert again == shapes[3]


def test_the_same_in_a_fresh_process() -> None:
    root = Path(__file__).parents[3]
    out = subprocess.run(
        [sys.executable, "-c", DIGEST, *NAMES],
        capture_output=True,
        text=True,
        check=True,
        cwd=root / "envs",
        env={"PYTHONPATH": f"{root}:{root / 'envs'}", "PYTHONHASHSEED": "77"},
    ).stdout.split()
    here = [
        hashlib.sha256(suite(name).building(variant).segments.xy.tobytes()).hexdigest()
        for name in NAMES
        for variant in (0, 5)
    ]
    assert out == here


def test_plain_buildings_stand_along_the_axes() -> None:
    for name in NAMES[:-1]:
        along = np.diff(suite(name).building(0).segments.xy.reshape(-1, 2, 2), axis=1)[:, 0]
        straight = np.abs(along).min(axis=1) < 1e-9
        assert straight.mean() > 0.6
        turned = np.diff(suite(name).building(1).segments.xy.reshape(-1, 2, 2), axis=1)[:, 0]
        assert (np.abs(turned).min(axis=1) > 1e-9).all()


def test_unknown_suites_and_names_that_are_taken() -> None:
    with pytest.raises(an.InputError, match=r"no suite 'ofice' of buildings; did you mean office"):
        suite("ofice")
    new = Suite("closet", "a small room", lambda variant, name: suite("hall").building(0))
    try:
        assert register_suite(new) is register_suite(new) is suite("closet")
        with pytest.raises(an.InputError, match=r"suite 'closet' of buildings already"):
            register_suite(Suite("closet", "another", new.draw))
    finally:
        _suites.pop("closet")
