"""Floors of a plan are chosen, and never subtracted from each other."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import shapely

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError, InputWarning


def load(folder: Path, *features: tuple[Any, dict[str, Any]], **options: Any) -> Environment:
    made = [
        {"type": "Feature", "geometry": shapely.geometry.mapping(shape), "properties": properties}
        for shape, properties in features
    ]
    path = folder / "house.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": made}))
    return load_environment(path, **options)


def floors(*names: Any) -> list[tuple[Any, dict[str, Any]]]:
    """Floors above each other, each a metre smaller than the one before."""
    return [(shapely.box(k, k, 20 - k, 12 - k), {"level": name}) for k, name in enumerate(names)]


def area(k: int) -> float:
    return (20.0 - 2 * k) * (12.0 - 2 * k)


def test_several_levels_and_none_chosen_are_listed(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"3 levels \(EG, 1\. OG, DG\), .* --level NAME"):
        load(tmp_path, *floors("EG", "1. OG", "DG"))


@pytest.mark.parametrize(
    ("names", "level", "k"),
    [
        (("EG", "OG"), "EG", 0),
        (("EG", "OG"), "og", 1),
        (("EG", "OG"), 0, 0),
        (("EG", "OG"), "1", 1),
        ((1, 0, 2), "0", 1),  # a name goes before a position
        ((1, 0, 2), 2, 2),
        ((-1, 0), "-1", 0),
        ((5, 4, 3), "0", 2),  # no such name: the lowest
        (("0", "1"), 1, 1),
        ((0.5, 1), 0.5, 0),
    ],
)
def test_a_level_by_name_or_position(tmp_path: Path, names: Any, level: Any, k: int) -> None:
    env = load(tmp_path, *floors(*names), level=level)
    assert env.free.area == pytest.approx(area(k))
    assert env.name.startswith("house ")


def test_levels_of_many_digits_are_not_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"1000001.*1000002"):
        load(tmp_path, *floors(1000001, 1000002))
    assert load(tmp_path, *floors(1000001, 1000002), level=1000002).free.area > 0.0


def test_one_level_needs_no_choice(tmp_path: Path) -> None:
    env = load(tmp_path, *floors("EG"))
    assert env.free.area == pytest.approx(area(0)) and env.name == "house"
    assert env.checksum == load(tmp_path, *floors("EG"), level="EG").checksum


def test_floors_of_one_file_are_not_the_same_building(tmp_path: Path) -> None:
    """Stored maps are distinguished by names and checksums."""
    two = [load(tmp_path, *floors("EG", "OG"), level=level) for level in ("EG", "OG")]
    assert two[0].checksum != two[1].checksum and two[0].name != two[1].name


def test_what_has_no_level_counts_for_all(tmp_path: Path) -> None:
    shaft = (shapely.box(8, 5, 10, 7), {"kind": "obstacle"})
    for k, level in enumerate(("EG", "OG")):
        with pytest.warns(InputWarning, match=r"1 of 2 features on level .. have no level"):
            env = load(tmp_path, *floors("EG", "OG"), shaft, level=level)
        assert env.free.area == pytest.approx(area(k) - 4)


@pytest.mark.parametrize("both", ["EG;OG", "EG; OG", ["EG", "OG"]])
def test_a_feature_on_several_levels(tmp_path: Path, both: Any) -> None:
    stairs = (shapely.box(8, 5, 10, 7), {"kind": "obstacle", "level": both})
    for k, level in enumerate(("EG", "OG")):
        env = load(tmp_path, *floors("EG", "OG"), stairs, level=level)
        assert env.free.area == pytest.approx(area(k) - 4)


def test_points_have_no_say(tmp_path: Path) -> None:
    label = (shapely.Point(1, 1), {"level": "roof"})
    with pytest.warns(InputWarning, match="1 points are left out"):
        assert load(tmp_path, *floors("EG"), label).free.area == pytest.approx(area(0))


def test_a_plan_without_levels_is_as_before(tmp_path: Path) -> None:
    """Unmarked polygons in each other: the inner one is an obstacle."""
    for properties in ({}, {"level": None}):
        unmarked = [(shape, properties) for shape, _ in floors(0, 1)]
        with pytest.warns(InputWarning, match="180 m² in 1 piece is not taken for floor"):
            env = load(tmp_path, *unmarked)
        assert env.free.area == pytest.approx(area(0) - area(1))


@pytest.mark.parametrize(
    ("names", "level", "words"),
    [
        (("EG", "OG"), "KG", "there is no level 'KG'"),
        (("Erdgeschoss", "Keller"), "Kelller", "did you mean Keller, of Erdgeschoss, Keller"),
        (("EG", "OG"), 2, "choose from EG, OG"),
        (("EG", "OG"), -1, "there is no level '-1'"),
        ((None,), "EG", "no feature has the property level"),
        ((True,), None, "level is True; it must be the name or number"),
        (({"name": "EG"},), None, "must be the name or number of a floor"),
    ],
)
def test_wrong_levels(tmp_path: Path, names: Any, level: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        load(tmp_path, *floors(*names), level=level)
    assert str(caught.value).startswith(str(tmp_path))


def test_many_levels_are_not_all_listed(tmp_path: Path) -> None:
    names = [f"floor {k}" for k in range(60)]
    same = [(shapely.box(0, 0, 5, 5), {"level": name}) for name in names]
    with pytest.raises(InputError, match=r"60 levels .* and 40 more") as caught:
        load(tmp_path, *same)
    assert len(str(caught.value)) < 600


def test_wkt_has_no_levels(tmp_path: Path) -> None:
    (tmp_path / "a.wkt").write_text(shapely.box(0, 0, 4, 3).wkt)
    with pytest.raises(InputError, match="no feature has the property level"):
        load_environment(tmp_path / "a.wkt", level="EG")
