from __future__ import annotations

import functools
import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.geometry.environment import Environment
from ambinav.geometry.segments import FRONTIER
from ambinav_envs.buildings.procedural import ROBOT
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.buildings.suites import SUITES, Suite, suite
from tests.envs.buildings.scenes import laser

TWINS = ("twin-rooms-seen", "twin-rooms", "triple-rooms")
NAMES = ("hall", "corridor", "office", "warehouse", "loop", *TWINS, "procedural")
VARIANTS = (*range(8), 1000, 2**31 - 1)

DIGEST = """
import hashlib, sys
from ambinav_envs.buildings.suites import suite
for name in sys.argv[1:]:
    for variant in (0, 5):
        print(hashlib.sha256(suite(name).building(variant).segments.xy.tobytes()).hexdigest())
"""


def test_there_are_eleven() -> None:
    assert SUITES.names() == (*NAMES, "cluttered", "standard")
    assert all(suite(name).title for name in SUITES.names())


@functools.cache
def drawn(name: str, variant: int) -> Environment:
    return suite(name).building(variant)


@pytest.mark.parametrize("name", NAMES)
def test_the_robot_gets_everywhere(name: str) -> None:
    for variant in VARIANTS:
        building = drawn(name, variant)
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
        assert 60.0 < building.free.area < 500.0
        # A robot of the usual size can stand on most of the floor.
        assert building.free.buffer(-0.27).area > 0.55 * building.free.area


@pytest.mark.parametrize("name", NAMES)
def test_buildings_of_a_suite_differ(name: str) -> None:
    shapes = [drawn(name, variant).segments.xy.tobytes() for variant in range(8)]
    assert len({hashlib.sha256(shape).digest() for shape in shapes}) == 8
    again = suite(name).building(3).segments.xy.tobytes()
    assert again == shapes[3]


@pytest.mark.slow
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


@pytest.mark.slow
def test_cluttered_buildings() -> None:
    legs, narrow = 0, 0
    for variant in (*range(4), 1_000_000):
        building = suite("cluttered").building(variant)
        assert building.name == f"cluttered-{variant}"
        assert isinstance(building.free, shapely.Polygon) and building.free.is_valid
        assert not (building.segments.kind == FRONTIER).any()
        # Most of the floor where a robot fits is one piece.
        pieces = shapely.area(shapely.get_parts(building.free.buffer(-0.25)))
        assert pieces.max() > 0.85 * pieces.sum()
        assert 60.0 < building.free.area < 450.0
        legs += sum(shapely.Polygon(hole).area < 0.02 for hole in building.free.interiors)
        # Where a robot of 0.35 m fits no more, one of the usual size does: doors below 0.8 m.
        narrow += building.free.buffer(-0.38).geom_type == "MultiPolygon"
        # No wall is a straight line for long.
        xy = building.segments.xy
        assert np.hypot(xy[:, 2] - xy[:, 0], xy[:, 3] - xy[:, 1]).max() < 0.8
    assert legs > 40 and narrow >= 2


def test_a_mixture_takes_each_suite_in_turn() -> None:
    mixed = suite("hall+cluttered+hall")
    assert "hall, cluttered" in mixed.title
    for variant, name in ((3, "hall"), (4, "cluttered"), (5, "hall")):
        building, own = mixed.building(variant), suite(name).building(variant)
        assert building.name == f"hall+cluttered+hall-{variant}"
        assert building.segments.xy.tobytes() == own.segments.xy.tobytes()
    source = BuildingSource("office+loop", laser(), 0.22, count=4, first=10)
    assert source.name == "office+loop" and source.get("office+loop-11") is source.get(11)
    with pytest.raises(an.InputError, match=r"there is no suite 'halt'.*hall"):
        suite("office+halt")


@pytest.mark.slow
def test_plain_buildings_stand_along_the_axes() -> None:
    for name in set(NAMES) - {"triple-rooms", "procedural"}:
        along = np.diff(suite(name).building(0).segments.xy.reshape(-1, 2, 2), axis=1)[:, 0]
        straight = np.abs(along).min(axis=1) < 1e-9
        assert straight.mean() > 0.6
        turned = np.diff(suite(name).building(1).segments.xy.reshape(-1, 2, 2), axis=1)[:, 0]
        assert (np.abs(turned).min(axis=1) > 1e-9).all()


def test_unknown_suites_and_names_that_are_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(an.InputError, match=r"no suite 'ofice'; did you mean office"):
        suite("ofice")
    monkeypatch.setattr(SUITES, "_registered", {})
    new = Suite("closet", "a small room", lambda variant, name: suite("hall").building(0))
    assert SUITES.register(new) is SUITES.register(new) is suite("closet")
    for taken in ("closet", "hall"):
        with pytest.raises(an.InputError, match=rf"suite '{taken}': there is one of that name"):
            SUITES.register(Suite(taken, "another", new.draw))
    with pytest.raises(an.InputError, match="called 'hall-0', not 'closet-3'"):
        suite("closet").building(3)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"name": "a.b"}, "suite 'a.b': the name has other characters"),
        ({"name": "a+b"}, r"suite 'a\+b': the name has other characters"),
        ({"members": ("hall",)}, "suite 'closet': give either draw or members"),
        ({"draw": None}, "give either draw or members"),
        ({"conditions": {}}, "conditions are none"),
        ({"conditions": {"a": None}}, r"condition .a. is None; give arguments of the environment"),
    ],
)
def test_suites_that_cannot_be(given: dict[str, Any], message: str) -> None:
    whole = {"name": "closet", "title": "", "draw": lambda variant, name: None}
    with pytest.raises(an.InputError, match=message):
        Suite(**{**whole, **given})


def test_a_suite_that_is_a_member_of_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(SUITES, "_registered", {})
    for name, member in (("first", "second"), ("second", "hall+first"), ("third", "second")):
        SUITES.register(Suite(name, "", members=("hall", member)))
    for name in ("first", "third", "office+second"):
        with pytest.raises(an.InputError, match=r"is a member of itself \(.* > .*\); leave out"):
            suite(name)


def test_the_standard_suite_draws_its_members_in_turn() -> None:
    for variant, name in ((4, "procedural"), (5, "hall")):
        standing = suite("standard").building(variant)
        assert standing.name == f"standard-{variant}"
        own = suite(name).building(variant)
        assert standing.segments.xy.tobytes() == own.segments.xy.tobytes()
