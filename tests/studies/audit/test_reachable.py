"""Audits count explored floor that the robot reaches, in figures, regions, pairs and words."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path

import numpy as np
import pytest
import shapely
from matplotlib.colors import to_rgb

from ambinav.buildings.boundary import environment_from_grid
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.cli.map import note_unjudged
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.geometry.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.plotting.maps import plot_layer, plot_zones
from ambinav.plotting.style import SOLID, UNEXPLORED, UNREACHABLE
from ambinav.plotting.style import UNKNOWN as UNKNOWN_SPACE
from ambinav.reports.number_text import metres2, percent
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.audit.advise import advise
from ambinav.studies.audit.aliasing import find_aliasing
from ambinav.studies.audit.ambiguous_regions import find_ambiguous_regions
from ambinav.studies.audit.audit import Audit, audit, robot_radius
from ambinav.studies.audit.document import document
from ambinav.studies.audit.report import write_audit
from tests.maps import synthetic

CELL = 0.1
LASER = RangeScanner.planar(
    RangeSensor(max_range=2.0, std=0.02, resolution=0.01), 36, math.tau, name="short laser"
)


def building() -> Environment:
    """Corridors of 13.6 and 8.6 m that meet, on a page; a closed crate; an unexplored hall.

    The page's margin is all open for the laser, and so is the inside of the crate, 5 x 5 m.
    """
    state = np.full((180, 240), FREE, dtype=np.uint8)
    state[40:150, 40:200] = OCCUPIED
    state[60:76, 44:180] = FREE  # y 6 .. 7.6
    state[60:146, 44:60] = FREE  # x 4.4 .. 6
    state[76:90, 60:80] = FREE  # side room
    state[95:145, 120:170] = FREE  # closed box, 5 m wide
    # At its east end the corridor opens into a hall whose walls nobody has seen: unknown.
    state[44:100, 180:198] = UNKNOWN
    state[48:94, 180:194] = FREE
    return environment_from_grid(OccupancyGrid(state, CELL))


@pytest.fixture(scope="module")
def place() -> Environment:
    return building()


@pytest.fixture(scope="module")
def amap(place) -> AmbiguityMap:
    return build_map(place, LASER, spacing=0.2)


@pytest.fixture(scope="module")
def found(place, amap) -> Audit:
    with pytest.warns(InputWarning):
        reach = find_reach(place, 0.25)
    aliasing = find_aliasing(amap.for_robot(reach), place, True)
    return audit(amap, place, LASER, reach=reach, aliasing=aliasing)


def cells(amap: AmbiguityMap, mask: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(mask)
    return np.column_stack([amap.dataset["x"].values[columns], amap.dataset["y"].values[rows]])


@pytest.mark.slow
def test_margin_and_crate_do_not_count(amap, found):
    def crate_and_margin(x, y):
        crate = (x > 12.0) & (x < 17.0) & (y > 9.5) & (y < 14.5)
        return crate, (x < 4.0) | (x > 20.0) | (y < 4.0) | (y > 15.0)

    crate, margin = crate_and_margin(*cells(amap, found.parts.counted).T)
    assert not (crate | margin).any()
    crate, margin = crate_and_margin(*cells(amap, found.parts.cut_off).T)
    assert crate.sum() * 0.04 == pytest.approx(4.5**2, rel=0.1)
    assert (crate | margin).all()


@pytest.mark.slow
def test_the_parts_add_up(amap, found):
    parts = found.parts
    stack = np.stack(
        [parts.counted, parts.unexplored, parts.beside_walls, parts.cut_off, parts.outside]
    )
    np.testing.assert_array_equal(stack.sum(axis=0), amap.dataset["free"].values.astype(int))
    assert (parts.unreachable == parts.beside_walls | parts.cut_off).all()
    shares = [share.share for share in found.shares]
    assert sum(shares) == pytest.approx(1.0)
    assert sum(share.area for share in found.shares) == pytest.approx(found.area)


@pytest.mark.slow
def test_what_has_room_is_at_least_the_radius_from_all_walls(place, amap, found):
    away = amap.dataset["clearance"].values
    free = amap.dataset["free"].values
    has_room = free & ~found.parts.beside_walls
    assert away[has_room].min() >= 0.25 * (1 - 0.0013)
    assert away[found.parts.beside_walls].max() < 0.25


@pytest.mark.slow
def test_unexplored_floor_is_a_row_of_its_own(amap, found):
    x, _ = cells(amap, found.parts.unexplored).T
    # In the middle of the hall, which is wider than the corridor.
    assert len(x) > 20
    assert (x > 17.0).all()
    report = document(found)
    assert report.floor.unexplored_area_m2 == pytest.approx(len(x) * 0.04)
    before = {share.zone: share for share in amap.zone_shares()}
    after = {share.zone: share for share in found.shares}
    # Nearly all that is open lies on the margin, in the crate and in the unknown.
    assert before["open"].share > 0.3
    assert after["open"].share < 0.05


def test_places_lie_on_floor_that_counts(amap, found):
    places = [finding.place for finding in found.findings]
    assert places[0].zone == "corridor"
    assert places[0].length > 5.0 and places[0].y == pytest.approx(6.8, abs=0.5)
    counted = cells(amap, found.parts.counted)
    for one in places:
        assert np.hypot(*(counted - (one.x, one.y)).T).min() < 1e-5
        assert one.area <= found.area
    # The same map by itself, for a robot of 0.2 m: the worst place is no margin and no crate.
    worst = find_ambiguous_regions(amap)[0]
    assert worst.zone == "corridor" and worst.y == pytest.approx(6.8, abs=0.5)


def test_look_alikes_are_sought_where_the_robot_goes(place, amap, found):
    assert found.aliasing is not None and found.aliasing.sought
    assert found.aliasing.poses == pytest.approx(found.area / found.aliasing.spacing**2, rel=0.15)
    assert 0.0 <= found.aliasing.share <= 1.0
    assert found.aliasing.area <= 1.15 * found.area
    for pair in found.aliasing.pairs:
        # Cells of a lattice of its own count as the map's cell that holds them.
        away = shapely.distance(found.reach.floor, shapely.points(pair.cells))
        assert away.max() < 0.5 * amap.spacing
    with pytest.warns(InputWarning):
        margin = find_reach(place, 0.25, (1.0, 1.0))
    outside = find_aliasing(amap.for_robot(margin), place, False)
    assert outside.poses > 2 * found.aliasing.poses


def test_words_say_of_what(found):
    area = found.area
    assert found.summary.startswith(
        f"With short laser a robot of radius 0.25 m can tell its position well on "
        f"{found.shares[0].share * 100:.0f} % of the {area:.0f} m² of explored floor that it "
        "can reach in grid."
    )
    assert "are unexplored (half of the beams or more end in unknown space)" in found.summary
    assert "cannot be reached by the robot" in found.summary


@pytest.mark.slow
def test_reports_tell_the_same(found, tmp_path):
    report = write_audit(found, tmp_path / "out")
    data = json.loads((tmp_path / "out" / "report.json").read_text())
    floor = data["floor"]
    assert floor["robot_radius_m"] == 0.25 and floor["from_m"] is None
    shares = [
        floor[f"{part}_share"] for part in ("counted", "unexplored", "unreachable", "outside")
    ]
    assert sum(shares) == pytest.approx(1.0, abs=3e-4)
    assert floor["unreachable_area_m2"] == pytest.approx(
        floor["beside_walls_area_m2"] + floor["cut_off_area_m2"]
    )
    assert any("rim of the map" in note for note in report.environment.notes)
    assert any("margin of a page" in note for note in data["environment"]["notes"])
    markdown = (tmp_path / "out" / "report.md").read_text()
    page = (tmp_path / "out" / "report.html").read_text()
    for text in (markdown, page):
        assert "not reachable by a robot of 0.25 m" in text.lower()
        assert "unexplored" in text
    assert UNREACHABLE in page and "repeating-linear-gradient" in page


def test_nothing_explored_at_all():
    # A fan in unknown space: the first sentence once said that all of it was open.
    state = np.full((120, 120), UNKNOWN, dtype=np.uint8)
    state[10:110, 10:110] = FREE
    state[59:61, 59:61] = OCCUPIED
    environment = environment_from_grid(OccupancyGrid(state, 0.02), gap=0.0)
    amap = build_map(environment, LASER, spacing=0.1)
    found = audit(amap, environment, LASER, reach=find_reach(environment, 0.2))
    assert found.area == 0.0 and found.findings == ()
    assert (
        "all of it unexplored" in found.summary and "constrains its position" not in found.summary
    )
    assert [share.share for share in found.shares] == [0.0] * 4
    assert document(found).floor.counted_share == 0.0
    aliasing = find_aliasing(found.amap, environment, True)
    assert (aliasing.poses, aliasing.sought) == (0, False)


def test_a_scanner_with_headings_counts_the_same_floor(building, laser):
    amap = AmbiguityMap(synthetic.dataset(headings=4))
    found = audit(amap, building, laser)
    report = document(found)
    inside = found.parts.counted
    level = amap.dataset["level"].values
    for k, row in enumerate(report.by_heading):
        assert row.level == pytest.approx(float(level[inside][:, k].mean()), abs=1e-4)
        assert sum(row.shares.values()) == pytest.approx(1.0, abs=1e-3)


def test_a_map_whose_cells_miss_the_floor_says_so(laser):
    environment = environment_from_shapes([np.array([[0, 0], [6, 0], [6, 0.9], [0, 0.9]])])
    amap = build_map(environment, LASER, spacing=0.5)
    with pytest.raises(InputError, match=r"0\.5 m apart, .* radius 0\.44 m reaches"):
        audit(amap, environment, LASER, reach=find_reach(environment, 0.44))


def test_the_radius_comes_from_the_scanner(laser):
    assert robot_radius(LASER) == 0.2
    text = LASER.to_yaml() + "robot_radius: 0.35\n"
    assert robot_radius(RangeScanner.from_yaml_text(text)) == 0.35


def test_a_mask_of_another_shape_is_refused(amap):
    with pytest.raises(InputError, match="mask has the shape"):
        amap.zone_shares(mask=np.ones((2, 2), dtype=bool))


def test_a_stored_map_knows_its_rim(place, amap, tmp_path):
    amap.save(tmp_path / "map.zarr")
    again = AmbiguityMap.open(tmp_path / "map.zarr")
    np.testing.assert_array_equal(again.solid, amap.solid)
    assert "solid" not in again.layers
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        one, other = find_reach(again.environment, 0.25), find_reach(place, 0.25)
    assert len(caught) == 4 and one.notes[1].endswith("takes another.")
    assert one.floor.area == pytest.approx(other.floor.area)


# -- pictures ---------------------------------------------------------------------------------


def shade(colour: str) -> float:
    linear = np.power(to_rgb(colour), 2.2)
    return float(np.power(linear @ [0.2126, 0.7152, 0.0722], 1 / 2.2))


def test_the_greys_stay_apart():
    greys = [shade(c) for c in (SOLID, UNREACHABLE, UNKNOWN_SPACE)]
    assert min(np.diff(greys)) > 0.15
    # Stripes are seen in grey print too.
    assert shade(UNKNOWN_SPACE) - shade(UNEXPLORED) > 0.2


def pixels(axes, points: np.ndarray) -> set[tuple[int, int, int]]:
    axes.figure.canvas.draw()
    buffer = np.asarray(axes.figure.canvas.buffer_rgba())
    columns, rows = axes.transData.transform(points).astype(int).T
    return {tuple(c) for c in buffer[buffer.shape[0] - 1 - rows, columns, :3].tolist()}


def byte(colour: str) -> tuple[int, int, int]:
    return tuple(round(255 * part) for part in to_rgb(colour))


@pytest.mark.slow
def test_pictures_show_what_does_not_count(amap, found):
    inside_crate = np.array([[14.5, 12.0], [13.0, 11.0]])
    block = np.array([[10.0, 12.0], [5.0, 5.0]])
    stripes = cells(amap, found.parts.unexplored)
    for axes in (
        plot_zones(amap, parts=found.parts, strokes=False),
        plot_layer(amap, "level", parts=found.parts),
    ):
        assert pixels(axes, inside_crate) == {byte(UNREACHABLE)}
        assert pixels(axes, block) == {byte(SOLID)}
        assert {byte(UNKNOWN_SPACE), byte(UNEXPLORED)} <= pixels(axes, stripes)
        assert pixels(axes, np.array([[19.7, 7.0]])) == {byte(UNKNOWN_SPACE)}
        labels = [text.get_text() for text in axes.get_legend().get_texts()]
        assert any(label.startswith("unexplored\n") for label in labels)
        assert any(label.startswith("not reachable by a\nrobot of 0.25 m, ") for label in labels)
        assert {"solid", "unknown"} <= set(labels)


@pytest.mark.slow
def test_shares_of_a_picture_are_of_what_counts(amap, found):
    labels = [t.get_text() for t in plot_zones(amap, parts=found.parts).get_legend().get_texts()]
    corridor = found.shares[2]
    assert f"corridor\n{percent(corridor.share)}, {metres2(corridor.area)}" in labels
    # Without a robot: of all that is explored.
    labels = [t.get_text() for t in plot_zones(amap).get_legend().get_texts()]
    corridor = amap.zone_shares(mask=amap.judged.counted)[2]
    assert f"corridor\n{percent(corridor.share)}, {metres2(corridor.area)}" in labels


def test_a_map_without_walls_is_not_judged(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All of it is outside: no figure says that something is localizable, or unexplored."""
    state = np.full((50, 60), FREE, dtype=np.uint8)
    state[20:25, 25:30] = OCCUPIED
    env = environment_from_grid(OccupancyGrid(state, CELL))
    far = RangeScanner.from_preset("turtlebot3-lds")
    amap = build_map(env, far, spacing=0.4)
    assert "of 0 m^2 judged\n" in repr(amap)
    with pytest.warns(InputWarning, match="touches the rim"):
        result = advise(audit(amap, env, far))
    assert result.verdict is not None and "outside of it" in result.verdict.sentence
    assert "are outside of the building" in result.summary
    assert "unexplored" not in result.summary + result.verdict.sentence
    write_audit(result, tmp_path / "out")
    text = (tmp_path / "out" / "report.md").read_text()
    assert f"localizable | 0.0 m² | {percent(None)} |" in text
    assert f"all explored, reachable floor | 0.0 m² | {percent(None)} | 0 % |" in text
    note_unjudged(amap)
    assert "outside of the building." in capsys.readouterr().err
