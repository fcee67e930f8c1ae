"""Two made-up maps whose difference is known: zones, level, floor, walls, parameters."""

from __future__ import annotations

import json

import numpy as np
import pytest
import shapely
import xarray as xr

from ambinav.geometry.collision.reach import reach_of
from ambinav.geometry.segments import Segments
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import NOT_FREE, ZONES
from ambinav.reports.conditions import judge, parse_condition
from ambinav.runtime.errors import InputError
from ambinav.studies.diff.difference import Difference, difference
from ambinav.studies.diff.document import Document, document
from ambinav.studies.diff.figures import QUANTITIES
from ambinav.studies.diff.registration import STATES
from ambinav.studies.diff.walls import missing_walls, total_length
from tests.maps import synthetic

CELL = synthetic.SPACING**2


def compared(
    first: xr.Dataset, second: xr.Dataset, places: int = 10
) -> tuple[Difference, Document]:
    found = difference(
        synthetic.for_a_point(first, "a.zarr"), synthetic.for_a_point(second, "b.zarr")
    )
    return found, document(found, places)


def block(data: xr.Dataset, xmin: float, xmax: float, ymin: float, ymax: float) -> np.ndarray:
    x, y = np.meshgrid(data["x"].values, data["y"].values)
    return (x > xmin) & (x < xmax) & (y > ymin) & (y < ymax)


def set_cells(data: xr.Dataset, mask: np.ndarray, level: float, zone: int) -> xr.Dataset:
    data = data.copy(deep=True)
    data["level"].values[mask] = level
    data["zone"].values[mask] = zone
    return data


def value(report: Document, name: str) -> float:
    quantity = QUANTITIES[name]
    return judge(parse_condition(f"{name} > 0 {quantity.unit}", QUANTITIES), report).value


def test_a_map_is_identical_to_itself():
    _, report = compared(synthetic.dataset(), synthetic.dataset())
    assert report.identical
    assert report.summary == "The maps are identical: every layer, wall and parameter is the same."
    names = set(QUANTITIES)
    assert {name for name in names if value(report, name) != 0.0} == set()
    assert report.regions == () and report.parameters == ()


def test_another_moment_is_no_difference():
    later = synthetic.dataset()
    later.attrs["created"] = "2026-02-02T00:00:00Z"
    assert compared(synthetic.dataset(), later)[1].identical


def test_a_level_that_falls_nowhere_falls_by_no_minus_nothing():
    first = synthetic.dataset()
    worse = set_cells(first, block(first, 5.0, 7.0, 0.0, 1.0), 1.0, 3)
    _, report = compared(first, worse)
    outcome = judge(parse_condition("largest level fall > 0.1", QUANTITIES), report)
    assert outcome.text.startswith("largest level fall is 0:")


@pytest.mark.parametrize("headings", [0, 4])
def test_one_parameter_is_told_and_nothing_else(headings):
    first, second = synthetic.dataset(headings), synthetic.dataset(headings)
    second.attrs["parameters"] = json.dumps(json.loads(second.attrs["parameters"]) | {"tau": 3.0})
    _, report = compared(first, second)
    assert not report.identical
    (one,) = report.parameters
    assert (one.name, one.before, one.after) == ("parameters.tau", "2", "3")
    assert report.summary == (
        "No floor, zone or level differs. Walls are the same within 0.1 m. 1 parameter differs."
    )


def test_another_robot_is_a_difference():
    """Floor is gone then though nothing was built: the report says what changed."""
    amap = synthetic.for_a_point(synthetic.dataset())
    wide = amap.for_robot(reach_of(amap.environment, 0.5))
    report = document(difference(amap, wide), 3)
    assert report.gone_floor_m2 > 0.0
    (changed,) = report.parameters
    assert (changed.name, changed.before, changed.after) == ("judged.robot_radius", "0.01", "0.5")


def test_another_building_in_space_is_a_difference():
    """A ceiling that is higher changes no wall of the plan."""
    first, second = synthetic.dataset(), synthetic.dataset()
    second.attrs["environment_space"] = "0123456789abcdef"
    (changed,) = compared(first, second)[1].parameters
    assert (changed.name, changed.before) == ("building in space", "a plan")
    assert changed.after == "0123456789ab"


def test_a_map_with_headings_is_held_against_one_without():
    found, report = compared(synthetic.dataset(4), synthetic.dataset())
    assert (report.first.headings, report.second.headings) == (4, None)
    assert "level_mean" in report.first.own_layers and report.second.own_layers == ()
    # The mean over the four headings is 0.75 of the level without.
    rise = found.rise[np.isfinite(found.rise)]
    np.testing.assert_allclose(rise, 0.25 * found.after.level[np.isfinite(found.rise)], atol=1e-6)
    assert report.changed_zone_m2 == 0.0


def test_two_scanners_are_told_by_their_values():
    first, second = synthetic.dataset(), synthetic.dataset()
    second.attrs["scanner_yaml"] = first.attrs["scanner_yaml"].replace("4.0", "6.0")
    assert second.attrs["scanner_yaml"] != first.attrs["scanner_yaml"]
    (one,) = compared(first, second)[1].parameters
    assert one.name.endswith("max_range") and (one.before, one.after) == ("4", "6")


def test_a_patch_that_got_worse():
    first = synthetic.dataset()
    mask = block(first, 1.0, 3.0, 1.0, 2.0)  # of the room, 2 m2, level 0.1
    second = set_cells(first, mask, 0.9, 3)
    found, report = compared(first, second)
    (one,) = report.regions
    assert (one.kind, one.before, one.after) == ("worse", "localizable", "open")
    assert one.area_m2 == pytest.approx(2.0) and one.change == pytest.approx(0.8, abs=1e-6)
    assert 1.0 < one.x_m < 3.0 and 1.0 < one.y_m < 2.0
    assert value(report, "new open area") == value(report, "lost localizable area") == 2.0
    assert value(report, "worse area") == 2.0 and value(report, "better area") == 0.0
    assert value(report, "largest level rise") == pytest.approx(0.8, abs=1e-4)
    both = float((found.before.counted & found.after.counted).sum())
    assert value(report, "mean level change") == pytest.approx(0.8 * mask.sum() / both, abs=1e-4)
    outcome = judge(parse_condition("new open area > 1 m2", QUANTITIES), report)
    assert outcome.holds and "it was localizable, it is open" in outcome.text
    # The other way round it got better.
    back = compared(second, first)[1]
    assert back.regions[0].kind == "better"
    assert value(back, "new localizable area") == value(back, "better area") == 2.0
    assert value(back, "largest level fall") == pytest.approx(0.8, abs=1e-4)
    assert value(back, "open change") == pytest.approx(-value(report, "open change"))


def test_floor_that_appears_and_vanishes():
    first = synthetic.dataset()
    mask = block(first, 18.5, 23.5, 3.0, 7.0)  # of the hall's open middle, 20 m2
    second = set_cells(first, mask, np.nan, NOT_FREE)
    second["free"].values[mask] = False
    _, report = compared(second, first)
    assert value(report, "new floor area") == pytest.approx(20.0)
    assert value(report, "new open area") == pytest.approx(20.0)
    assert [(one.kind, one.after) for one in report.regions] == [("new floor", "open")]
    assert value(compared(first, second)[1], "gone floor area") == pytest.approx(20.0)


def test_the_table_agrees_with_counting_cell_by_cell():
    rng = np.random.default_rng(3)
    first, second = synthetic.dataset(), synthetic.dataset()
    for data in (first, second):
        cells = (data["zone"].values != NOT_FREE) & (rng.random(data["zone"].shape) < 0.3)
        data["zone"].values[cells] = rng.integers(0, 4, cells.sum())
    _, report = compared(first, second)
    counted = {}
    for a, b in zip(first["zone"].values.ravel(), second["zone"].values.ravel(), strict=True):
        if a != NOT_FREE:
            counted[a, b] = counted.get((a, b), 0) + 1
    found = {(one.before, one.after): one.area_m2 for one in report.transitions}
    assert found == {
        (ZONES[a], ZONES[b]): pytest.approx(number * CELL) for (a, b), number in counted.items()
    }
    assert sum(one.share for one in report.transitions) == pytest.approx(1.0, abs=1e-3)
    moved = sum(number for (a, b), number in counted.items() if a != b)
    assert report.changed_zone_m2 == pytest.approx(moved * CELL)


@pytest.mark.parametrize(("left", "low"), [(0, 0), (12, 0), (0, 7), (30, 40)])
def test_maps_are_registered_by_their_frame(left, low):
    """The same building on a lattice that begins elsewhere: nothing has changed."""
    first = synthetic.dataset()
    dims = {"x": slice(left, None), "y": slice(low, None)}
    found, report = compared(first, first.isel(dims))
    assert not found.lattice.resampled
    cut = np.ones(first["free"].shape, dtype=bool)
    cut[low:, left:] = False
    outside = float((first["free"].values & cut).sum()) * CELL
    assert report.gone_floor_m2 == pytest.approx(outside)
    assert value(report, "changed zone area") == value(report, "mean level change") == 0.0
    states = {one.after for one in report.transitions if one.before != one.after}
    assert states == ({"outside"} if outside else set())
    back = compared(first.isel(dims), first)[1]
    assert back.new_floor_m2 == report.gone_floor_m2
    assert back.lattice.bounds_m == report.lattice.bounds_m


@pytest.mark.parametrize("coarse_first", [True, False])
def test_another_spacing_is_read_on_the_coarser_lattice(coarse_first):
    fine = synthetic.dataset()
    coarse = fine.isel(x=slice(1, None, 3), y=slice(1, None, 3))
    parameters = json.loads(fine.attrs["parameters"]) | {"spacing": 0.3}
    coarse = coarse.assign_attrs(parameters=json.dumps(parameters))
    found, report = compared(*((coarse, fine) if coarse_first else (fine, coarse)))
    assert found.lattice.resampled and report.lattice.spacing_m == pytest.approx(0.3)
    # Every third cell is the centre of a coarse one, so that nothing but rounding differs.
    assert report.changed_zone_m2 == 0.0 and report.level is not None
    assert report.level.largest_rise == report.level.largest_fall == 0.0
    assert [one.name for one in report.parameters] == ["parameters.spacing"]


def test_half_a_cell_off_is_read_between_cells():
    first = synthetic.dataset()
    second = first.assign_coords(x=first["x"] + 0.05)
    found, report = compared(first, second)
    assert found.lattice.resampled
    assert report.level is not None and abs(report.level.mean_change) < 0.01


def test_maps_that_do_not_overlap_are_refused():
    first = synthetic.dataset()
    with pytest.raises(InputError, match=r"b\.zarr: the map \(x 499\.5 .*does not overlap a\.zarr"):
        compared(first, first.assign_coords(x=first["x"] + 500.0))


def test_maps_that_do_not_fit_together_are_told():
    """A map whose walls all lie elsewhere: its origin was lost, say."""
    first = synthetic.for_a_point(synthetic.dataset()).dataset
    second = first.copy(deep=True)
    second["segments"].values[:] += 0.7
    report = document(difference(AmbiguityMap(first), AmbiguityMap(second)), 10)
    assert report.summary.startswith("More than 40% of the walls of either map are not in the")
    assert report.walls.before_m == report.walls.after_m


def test_maps_in_other_frames_are_refused():
    second = synthetic.dataset()
    second.attrs["frame"] = "earth"
    with pytest.raises(InputError, match="frame 'earth'"):
        compared(synthetic.dataset(), second)


def test_no_common_floor_has_no_level():
    first, second = synthetic.dataset(), synthetic.dataset()
    for data, mask in ((first, block(first, 4, 30, 0, 10)), (second, block(first, 0, 4, 0, 10))):
        data["free"].values[mask] = False
    _, report = compared(first, second)
    assert report.level is None and "No floor counts in both maps." in report.summary
    with pytest.raises(InputError, match="no floor counts in both maps"):
        value(report, "worse area")


def test_layers_of_one_map_only_are_told():
    second = synthetic.dataset()
    second["gfm"] = second["level"].copy()
    _, report = compared(synthetic.dataset(), second)
    assert report.second.own_layers == ("gfm",) and report.first.own_layers == ()
    assert value(report, "differing layers") == 1


def test_states_are_zones_and_reasons():
    assert STATES[: len(ZONES)] == ZONES


def walls(*ends: tuple[float, float, float, float], frontier: int = 0) -> Segments:
    kind = np.zeros(len(ends), dtype=np.uint8)
    kind[len(ends) - frontier :] = 1
    return Segments(np.array(ends, dtype=float).reshape(-1, 4), kind)


@pytest.mark.parametrize(
    ("ours", "theirs", "length"),
    [
        (walls((0, 0, 4, 0)), walls((0, 0, 4, 0)), 0.0),
        (walls((0, 0, 4, 0)), walls((4, 0, 0, 0)), 0.0),  # turned round
        (walls((0, 0, 4, 0)), walls((0, 0.09, 4, 0.09)), 0.0),  # off by less than the tolerance
        (walls((0, 0, 4, 0)), walls((0, 0.5, 4, 0.5)), 4.0),
        (walls((0, 0, 4, 0)), walls((0, 0, 1, 0), (3, 0, 4, 0)), 1.8),  # a gap of 2 m less 2 x 0.1
        (walls((0, 0, 4, 0)), walls((0, 0, 1, 0), (1, 0, 4, 0)), 0.0),  # in two parts
        (walls((0, 0, 4, 0)), walls((0, 0, 4, 0), frontier=1), 4.0),  # a frontier is no wall
        (walls((0, 0, 4, 0), frontier=1), walls((9, 9, 9, 8)), 0.0),
        (walls((0, 0, 4, 0)), walls(), 4.0),
        (walls(), walls((0, 0, 4, 0)), 0.0),
        (walls((0, 0, 0.05, 0)), walls(), 0.0),  # a speck
    ],
)
def test_walls_that_are_missing(ours, theirs, length):
    found = missing_walls(ours, theirs, 0.1)
    assert total_length(found) == pytest.approx(length, abs=0.01)


def test_walls_agree_with_one_difference_of_all():
    """Of random walls, against shapely's difference of all of them at once."""
    rng = np.random.default_rng(7)
    start = rng.uniform(0, 20, (60, 2))
    ends = np.hstack([start, start + rng.normal(0, 2, (60, 2))])
    ours, theirs = walls(*ends[:40]), walls(*ends[25:])
    found = shapely.multilinestrings(missing_walls(ours, theirs, 0.1).reshape(-1, 2, 2))
    lines, others = (shapely.multilinestrings(one.xy.reshape(-1, 2, 2)) for one in (ours, theirs))
    wanted = lines.difference(others.buffer(0.1))
    assert found.hausdorff_distance(wanted) < 0.15  # stretches shorter than 0.1 are left out
    assert found.length == pytest.approx(wanted.length, abs=0.3)


def test_two_files_of_one_building() -> None:
    """Their names and bytes differ, and nothing that decides a number."""
    first, second = synthetic.dataset(), synthetic.dataset()
    second.attrs |= {"environment": "copy", "environment_sha256": "1" * 64}
    found, _ = compared(first, second)
    assert found.parameters == ()
    second["segments"].values[0, 0] -= 0.5
    found, _ = compared(first, second)
    assert [one.name for one in found.parameters] == ["environment", "environment_sha256"]
