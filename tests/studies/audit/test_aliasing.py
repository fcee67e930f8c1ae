"""Aliased poses in an audit: paired where symmetry says, reported, and never slow unasked."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
import shapely
from PIL import Image

import ambinav as an
from ambinav.layers.context import LayerContext
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.studies.audit import aliasing as module
from ambinav.studies.audit.aliasing import AliasingFindings, find_aliasing, own_places, seek
from ambinav.studies.audit.audit import audit
from ambinav.studies.audit.document import Document
from ambinav.studies.audit.report import write_audit
from tests.maps import synthetic
from tests.studies.audit import symmetric
from tests.studies.audit.symmetric import PERIOD


@pytest.fixture(scope="module")
def rooms() -> an.Environment:
    """Three equal rooms, each with its door to a corridor that has a bend at one end."""
    parts = [shapely.box(-3, 0, 3 * PERIOD, 1.5), shapely.box(-3, -2, -1, 0.1)]
    for i in range(3):
        parts.append(shapely.Polygon(
            [(x + i * PERIOD, y) for x, y in ((0.2, 1.8), (3.8, 1.8), (3.8, 4.6), (1.2, 5.2))]
        ))  # fmt: skip
        parts.append(shapely.box(i * PERIOD + 1.5, 1.4, i * PERIOD + 2.4, 1.9))
    return an.environment_from_shapes([shapely.union_all(parts)])


@pytest.fixture(scope="module")
def found(rooms, laser) -> tuple[AmbiguityMap, AliasingFindings]:
    amap = an.build_map(rooms, laser, spacing=0.2)
    return amap, find_aliasing(amap, rooms)


def test_equal_rooms_are_paired(found):
    amap, aliasing = found
    assert aliasing.sought
    assert aliasing.spacing == 0.25
    assert 0.2 < aliasing.share < 0.9
    assert 0.0 < aliasing.area <= amap.judged.area(amap.judged.counted)
    first = [pair for pair in aliasing.pairs if pair.letter == "A"]
    assert len(first) == 2
    for pair in first:
        assert abs(pair.turn) < 0.05
        assert pair.other_y == pytest.approx(pair.y, abs=0.05)
        shift = (pair.other_x - pair.x) / PERIOD
        assert shift == pytest.approx(round(shift), abs=0.02)
        assert abs(pair.distance - abs(shift) * PERIOD) < 0.05
        assert pair.area > 5.0
        assert pair.likeness > 0.3
        offsets = pair.images - pair.cells
        assert np.abs(offsets - offsets[0]).max() < 0.2
    assert len({round(pair.other_x / PERIOD, 1) for pair in first}) == 2
    assert [pair.letter for pair in aliasing.pairs] == sorted(
        pair.letter for pair in aliasing.pairs
    )
    area = sum({pair.letter: pair.area for pair in aliasing.pairs}.values())
    assert area < amap.free_area


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "fold"), [(symmetric.crossing, 4), (symmetric.hexagon, 6)], ids=["crossing", "hexagon"]
)
def test_turned_places_are_paired(make, fold, laser):
    """Each arm with all the others, a place at its start's own turned by whole steps."""
    env = make()
    aliasing = find_aliasing(an.build_map(env, laser, spacing=0.1), env)
    first = [pair for pair in aliasing.pairs if pair.letter == "A"]
    steps = {round(pair.turn / math.tau * fold) % fold: pair for pair in first}
    assert sorted(steps) == list(range(1, fold))
    assert len(first) == fold - 1
    for step, pair in steps.items():
        turn = math.tau * step / fold
        assert math.remainder(pair.turn - turn, math.tau) == pytest.approx(0.0, abs=0.01)
        there = (pair.x + 1j * pair.y) * np.exp(1j * turn)
        assert abs(complex(pair.other_x, pair.other_y) - there) < 0.02
        assert pair.likeness > 0.9
        assert pair.area > 1.0
        # And so is every pose of the region with its own.
        cells, images = (part @ [1.0, 1j] for part in (pair.cells, pair.images))
        assert np.median(np.abs(images - cells * np.exp(1j * turn))) < 0.01


@pytest.mark.slow
def test_few_are_sought_from_in_a_large_building(found, rooms, monkeypatch):
    amap, aliasing = found
    here = LayerContext.of(amap, rooms)
    assert seek(amap, here)[1].all()
    monkeypatch.setattr(module, "MOST_POSES", len(here.points[0]) // 3)
    some, sought = seek(amap, here)
    assert 0.15 < sought.mean() < 0.35
    assert np.isfinite(some.share[sought]).all() and np.isnan(some.share[~sought]).all()
    # Those that were not are followed to.
    assert np.isfinite(some.poses[~sought, 0, 0, 3]).sum() > 100
    few = find_aliasing(amap, rooms, True)
    assert few.sought
    assert few.share == pytest.approx(aliasing.share, abs=0.1)
    assert len([pair for pair in few.pairs if pair.letter == "A"]) == 2


@pytest.mark.slow
def test_report_shows_them(found, rooms, laser, tmp_path):
    amap, aliasing = found
    report = write_audit(audit(amap, rooms, laser, places=0, aliasing=aliasing), tmp_path / "out")
    assert report.aliasing is not None and report.aliasing.picture == "floor-aliasing.png"
    with Image.open(tmp_path / "out" / "floor-aliasing.png") as picture:
        assert min(picture.size) > 500
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    assert Document.model_validate(data) == report
    pair = data["aliasing"]["pairs"][0]
    assert (pair["letter"], pair["turn_deg"] % 360) == ("A", pytest.approx(0.0, abs=3.0))
    (row,) = report.aliasing.repetitions
    assert (row.letter, row.count, row.direction_deg) == ("A", 3, 0.0)
    assert row.period_m == pytest.approx(PERIOD, abs=0.03)
    for name in ("report.md", "report.html"):
        text = (tmp_path / "out" / name).read_text()
        assert "Perceptual aliasing" in text
        assert row.sentence in text
        assert f"{pair['other_x_m']:.1f}, {pair['other_y_m']:.1f}" in text
    # A second report replaces the first, picture and all.
    write_audit(audit(amap, rooms, laser, places=0), tmp_path / "out")
    assert not (tmp_path / "out" / "floor-aliasing.png").exists()


@pytest.mark.slow
def test_not_sought_unasked_in_a_large_building(found, rooms, laser, tmp_path, monkeypatch):
    amap, aliasing = found
    monkeypatch.setattr(module, "MOST_POSES", aliasing.poses - 1)
    left = find_aliasing(amap, rooms)
    assert (left.sought, left.pairs, left.poses) == (False, (), aliasing.poses)
    assert math.isnan(left.share)
    report = write_audit(audit(amap, rooms, laser, places=0, aliasing=left), tmp_path / "out")
    assert report.aliasing is not None and report.aliasing.share is None
    assert "--aliasing" in (tmp_path / "out" / "report.md").read_text()
    assert "--aliasing" in (tmp_path / "out" / "report.html").read_text()
    assert not find_aliasing(amap, rooms, False).sought


def test_own_places_are_corridors_and_halls():
    amap = AmbiguityMap(synthetic.dataset())
    x = np.array([2.0, 8.0, 12.0, 21.0, 17.0, -3.0])
    room, left, right, hall, rim, outside = own_places(amap, x, np.array([2.0, 2, 2, 5, 5, 2.0]))
    assert room == outside == 0
    assert left == right > 0
    assert hall == rim > 0
    assert hall != left


@pytest.mark.slow
def test_a_building_without_aliased_pairs_says_so(laser, tmp_path):
    env = an.environment_from_shapes([shapely.Polygon([(0, 0), (3, 0), (3.5, 1.2), (1.2, 2.6)])])
    amap = an.build_map(env, laser, spacing=0.2)
    aliasing = find_aliasing(amap, env)
    assert aliasing.sought and aliasing.pairs == ()
    report = write_audit(audit(amap, env, laser, places=0, aliasing=aliasing), tmp_path / "out")
    assert "floor-aliasing.png" not in report.pictures
    assert "No two regions are aliased." in (tmp_path / "out" / "report.md").read_text()
