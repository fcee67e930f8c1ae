from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import ambinav as an
from ambinav_envs.buildings.source import BuildingSource
from tests.envs.buildings.scenes import RADIUS, laser, room

ROOM = '{"type": "Polygon", "coordinates": [[[0, 0], [4, 0], [4, 3], [0, 3], [0, 0]]]}'


def source(what: object = "hall", **options: int | None) -> BuildingSource:
    return BuildingSource(what, laser(), RADIUS, **options)  # type: ignore[arg-type]


def test_numbers_and_keys() -> None:
    halls = source(count=3, first=5)
    building = halls.get(6)
    assert building.key == building.environment.name == "hall-6"
    assert halls.get("hall-6") is building is halls.get(np.int64(6))
    assert repr(source(count=np.int64(3), first=np.int64(5))) == repr(halls)
    assert building.robot_radius == RADIUS and building.keep
    for wrong in (4, 8, -1, True, "hall-8", "hall", "office-6", "hall-six", "", 6.0, None):
        with pytest.raises(an.InputError, match=r"give a number from 5 to 7, or a key: 'hall-5'"):
            halls.get(wrong)  # type: ignore[arg-type]


def test_drawn_ones_lie_in_the_range() -> None:
    rng = np.random.default_rng(0)
    train, test = source(count=4), source(count=3, first=4)
    keys = [{one.at(rng.random()).key for _ in range(60)} for one in (train, test)]
    assert keys == [{f"hall-{k}" for k in range(4)}, {f"hall-{k}" for k in range(4, 7)}]
    first, second = ([source().at(np.random.default_rng(3).random()).key] for _ in range(2))
    assert first == second


def test_without_a_count_every_building_is_new_and_none_is_kept() -> None:
    endless = source(first=100)
    rng = np.random.default_rng(1)
    keys = {endless.at(rng.random()).key for _ in range(20)}
    assert len(keys) == 20
    assert not endless.get(100).keep
    with pytest.raises(an.InputError, match="from 100 to 2147483647"):
        endless.get(99)


def test_only_the_latest_are_held() -> None:
    halls = source(count=5, held=2)
    a, b = halls.get(0), halls.get(1)
    assert halls.get(0) is a
    halls.get(2)
    assert halls.get(0) is a
    assert halls.get(1) is not b


def test_a_copy_draws_the_same() -> None:
    halls = source(count=5)
    before = halls.get(1)
    other = pickle.loads(pickle.dumps(halls))
    assert len(pickle.dumps(halls)) < 10_000
    after = other.get(1)
    np.testing.assert_array_equal(after.environment.segments.xy, before.environment.segments.xy)
    assert repr(other) == repr(halls) == "BuildingSource('hall', 0..4)"


def test_a_map(tmp_path: Path) -> None:
    path = tmp_path / "cell.geojson"
    path.write_text(ROOM)
    for what, name in ((path, "cell"), (str(path), "cell"), (room(), "room")):
        one = source(what)
        building = one.get(0)
        assert building.key == one.name == name
        assert one.get(name) is building is one.at(0.5)
        assert one.count == 1
        with pytest.raises(an.InputError, match=f"from 0 to 0, or a key: '{name}'"):
            one.get("hall-0")
    with pytest.raises(an.InputError, match="cell is one building, but buildings is 5"):
        source(path, count=5)


@pytest.mark.parametrize(
    ("what", "options", "words"),
    [
        ("hal", {}, "there is no suite 'hal'; did you mean hall"),
        ("nowhere.geojson", {}, "nowhere.geojson"),
        ("hall", {"first": -1}, "first_building is -1"),
        ("hall", {"count": 0}, "buildings is 0"),
        (3, {}, "the buildings are of the type int; name a suite, or give"),
        ("hall", {"count": 2, "first": 2**31 - 1}, "numbers end at 2147483647"),
        ("hall", {"held": 0}, "held"),
    ],
)
def test_what_cannot_be(what: object, options: dict[str, int], words: str) -> None:
    with pytest.raises(an.InputError, match=words):
        source(what, **options)
