"""Advice of an audit: what was tried is what a whole map of it says, and the decision follows."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely
from typer.testing import CliRunner

import ambinav as an
from ambinav.cli import app
from ambinav.drive.bootstrap import Interval
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.reports.conditions import parse_condition
from ambinav.sensing.preset_summary import field_of_view, preset_summaries
from ambinav.studies.audit.advise import LITTLE, advise, decide
from ambinav.studies.audit.audit import Audit, audit
from ambinav.studies.audit.counterfactual.alternatives import (
    other_models,
    scanner_changes,
    wider_apertures,
)
from ambinav.studies.audit.counterfactual.posts import find_posts
from ambinav.studies.audit.counterfactual.sample import BAD, FloorSample
from ambinav.studies.audit.counterfactual.search import PAYS, Counterfactual, as_good
from ambinav.studies.audit.counterfactual.trips import find_trips
from ambinav.studies.audit.document import document
from ambinav.studies.audit.figures import QUANTITIES
from ambinav.studies.audit.gate_check import BY_AREA, FIXED, GateCheck
from ambinav.studies.audit.post_search import posts_part
from ambinav.studies.audit.report import write_audit
from ambinav.studies.audit.verdict import CHOICE
from ambinav.studies.design.improved import most_improved
from tests.maps import synthetic

SPACING = 0.25


def laser(max_range: float = 4.0, aperture: float = math.tau) -> an.RangeScanner:
    sensor = an.RangeSensor(max_range=max_range, std=0.03, resolution=0.001)
    return an.RangeScanner.planar(sensor, 60, aperture, name="test laser")


def warehouse() -> an.Environment:
    racks = [shapely.box(6.0, 3.0 + 4.2 * k, 34.0, 4.2 + 4.2 * k) for k in range(5)]
    hall = shapely.box(0.0, 0.0, 40.0, 26.0)
    return an.environment_from_shapes([hall.difference(shapely.union_all(racks))], name="warehouse")


def examined(env: an.Environment, scanner: an.RangeScanner) -> Audit:
    return audit(an.build_map(env, scanner, spacing=SPACING), env, scanner, places=0)


@pytest.fixture(scope="module")
def racks() -> Audit:
    return examined(warehouse(), laser())


@pytest.fixture(scope="module")
def advised(racks: Audit) -> Audit:
    return advise(racks, posts=0)


def bad_area(amap: an.AmbiguityMap, counted: np.ndarray) -> float:
    return float((np.isin(amap.floor("zone").values, BAD) & counted).sum()) * amap.cell_area


@pytest.mark.parametrize("name", ["hc-sr04", "vl53l5cx", "hokuyo-urg-04lx"])
def test_a_scanner_has_one_aperture(name: str, building: an.Environment) -> None:
    """The list of presets, the report and the advice say the same, cones included."""
    (row,) = (summary for summary in preset_summaries() if summary.name == name)
    scanner = an.RangeScanner.from_preset(name)
    shown = audit(AmbiguityMap(synthetic.dataset()), building, scanner, places=0)
    reported_aperture = document(shown).scanner.aperture_deg
    assert reported_aperture == pytest.approx(math.degrees(row.aperture), abs=0.051)
    for change in wider_apertures(scanner):
        now, then = re.findall(r"[\d.]+(?=°)", change.title)[::-1]
        assert now == row.row()[3].rstrip("°")
        assert float(then) == pytest.approx(math.degrees(field_of_view(change.scanner)), abs=0.5)
    apertures = {summary.name: summary.row()[3] for summary in preset_summaries()}
    for change in other_models(scanner):
        assert change.title.endswith(f", {apertures[change.title.split()[1]]})")


@pytest.mark.slow
@pytest.mark.parametrize("aperture", [math.tau, math.radians(240.0)])
def test_a_scanner_at_places_is_a_map_of_it(aperture: float) -> None:
    """To the last place, also where the present map has headings and the other has none."""
    room = shapely.box(0.0, 0.0, 9.0, 3.0).union(shapely.box(3.0, 3.0, 5.0, 11.0))
    env = an.environment_from_shapes([room], name="T")
    scanner = laser(3.0, aperture)
    amap = an.build_map(env, scanner, spacing=SPACING)
    floor = FloorSample.of(amap, env, scanner)
    for change in [*scanner_changes(scanner, env)][:5]:
        other = an.build_map(env, change.scanner, spacing=SPACING)
        zones = other.floor("zone").values[amap.judged.counted]
        np.testing.assert_array_equal(floor.zones([change.scanner], floor.floor)[0], zones)


def test_all_places_leave_no_doubt_and_some_leave_it_honestly(racks: Audit) -> None:
    floor = FloorSample.of(racks.amap, racks.environment, racks.scanner)
    other = laser(10.0)
    whole = floor.zones([other], floor.floor)[0]
    exact = float(np.isin(whole, BAD).sum()) * floor.cell_area
    every = floor.area_in(BAD, whole[floor.was_bad], whole[~floor.was_bad])
    assert (every.low, every.value, every.high) == pytest.approx((exact,) * 3)
    held = 0
    for seed in range(60):
        bad, others = floor.drawn(60, 40, np.random.default_rng(seed))
        at = [np.searchsorted(floor.floor, points) for points in (bad, others)]
        found = floor.area_in(BAD, whole[at[0]], whole[at[1]])
        held += found.low <= exact <= found.high
        assert found.low <= found.value <= found.high
    assert held >= 54  # of 95 % of 60, three standard deviations of chance


@pytest.mark.slow
def test_places_that_gain_most_are_those_of_a_whole_map(racks: Audit) -> None:
    """They lie on floor that improves, hold no more than improves, and samples estimate them."""
    floor = FloorSample.of(racks.amap, racks.environment, racks.scanner)
    other = laser(7.0)
    whole = floor.zones([other], floor.floor)[0]
    bad = floor.floor[floor.was_bad]
    places = floor.improved(bad, whole[floor.was_bad])
    changed = an.build_map(racks.environment, other, spacing=SPACING)
    for exact in most_improved(racks.amap, changed):
        assert exact.area_m2 <= places[0].area_m2 + 0.01
    areas = [place.area_m2 for place in places]
    assert areas == sorted(areas, reverse=True)
    removed = (floor.was_bad & ~np.isin(whole, BAD)).sum() * floor.cell_area
    assert 0.0 < sum(areas) <= removed + 0.02
    for place in places:
        assert racks.amap.sample("zone", place.x_m, place.y_m) in BAD
        assert changed.sample("zone", place.x_m, place.y_m) not in BAD
    sample, _ = floor.drawn(400, 10, np.random.default_rng(0))
    drawn = floor.improved(sample, whole[np.searchsorted(floor.floor, sample)])
    share = areas[0] / floor.bad_area
    allowed = 3.0 * math.sqrt(share * (1.0 - share) / 400) * floor.bad_area
    assert abs(drawn[0].area_m2 - areas[0]) <= allowed
    assert floor.improved(bad, np.full(len(bad), BAD[0])) == ()


def test_a_warehouse_is_told_to_see_farther(racks: Audit, advised: Audit) -> None:
    verdict = advised.verdict
    assert verdict is not None
    first = verdict.advice[0]
    assert verdict.decision == first.kind == "range"
    assert verdict.sentence.startswith(first.title)
    assert first.size >= 12.0
    assert first.scanner is not None
    after = bad_area(
        an.build_map(racks.environment, first.scanner, spacing=SPACING), racks.parts.counted
    )
    assert first.after.low <= after <= first.after.high
    assert after < 0.35 * verdict.before
    assert verdict.before == pytest.approx(bad_area(racks.amap, racks.parts.counted))
    assert all(one.removed >= PAYS * verdict.before for one in verdict.advice)
    assert len({one.kind for one in verdict.advice}) == len(verdict.advice)


def test_of_what_does_as_well_the_least_work_comes_first(advised: Audit) -> None:
    assert advised.verdict is not None
    one, *_ = advised.verdict.tried
    far, near = replace(one, kind="scanner", size=0.0), replace(one, kind="range", size=12.0)
    farther = replace(near, size=30.0)
    useless = replace(near, kind="mounting", after=replace(one.after, value=one.before))
    assert as_good([far, farther, near, useless]) == (near, farther, far)


@pytest.mark.parametrize("posts", [None, 0])
def test_a_good_building_has_nothing_to_do(posts: int | None) -> None:
    shape = shapely.box(0.0, 0.0, 6.0, 4.0).difference(shapely.box(2.0, 1.0, 2.5, 1.6))
    found = advise(
        examined(an.environment_from_shapes([shape], name="office"), laser(12.0)), posts=posts
    )
    assert found.verdict is not None
    assert (found.verdict.decision, found.verdict.advice, found.helps) == ("nothing", (), None)
    assert found.verdict.before <= LITTLE * found.area
    assert found.verdict.sentence.startswith("Nothing to do: with test laser")


@pytest.mark.slow
def test_where_nothing_helps_it_says_so() -> None:
    """A corridor longer than any scanner sees: only its ends are known."""
    corridor = an.environment_from_shapes([shapely.box(0.0, 0.0, 240.0, 2.0)], name="corridor")
    found = advise(examined(corridor, laser(30.0)), posts=0)
    assert found.verdict is not None
    assert (found.verdict.decision, found.verdict.advice) == ("none", ())
    assert "no tested change removes a tenth" in found.verdict.sentence
    # Routes were tried: to plan around it helps no more than the rest.
    assert any(change.kind == "routes" for change in found.verdict.tried)
    assert "plan around it" not in found.verdict.sentence


@pytest.mark.slow
def test_a_gate_decides_what_is_enough(racks: Audit) -> None:
    def verdict(text: str) -> tuple[str, bool, float]:
        gate = GateCheck([parse_condition(text, QUANTITIES)], racks)
        found = advise(racks, posts=0, gate=gate).verdict
        assert found is not None
        after = found.advice[0].after.value if found.advice else found.before
        return found.decision, found.gated, after

    assert verdict("corridor > 95 %") == ("nothing", False, pytest.approx(racks_bad(racks)))
    decision, gated, after = verdict("corridor > 40 %")
    assert (decision, gated) == ("range", True)
    assert after <= 0.4 * racks.area
    decision, gated, _ = verdict("corridor > 0.1 %")
    assert (decision, gated) == ("range", False)


@pytest.fixture(scope="module")
def looking_ahead() -> Audit:
    """A hall and a scanner that sees half of the horizon: the heading matters."""
    hall = an.environment_from_shapes([shapely.box(0.0, 0.0, 12.0, 8.0)], name="hall")
    return examined(hall, laser(2.5, math.pi))


def gate_on(audited: Audit, *texts: str) -> GateCheck:
    return GateCheck([parse_condition(text, QUANTITIES) for text in texts], audited)


@pytest.mark.slow
def test_a_gate_is_judged_on_the_report(looking_ahead: Audit) -> None:
    """Also where its figures do not follow from the areas of the zones."""
    report = document(looking_ahead)
    (open_zone,) = (zone for zone in report.zones if zone.zone == "open")
    assert open_zone.share_worst_heading is not None
    limit = 50.0 * (open_zone.share + open_zone.share_worst_heading)
    worst = f"open at worst heading > {limit:.2f} %"
    assert gate_on(looking_ahead, worst).failing
    assert not gate_on(looking_ahead, f"open > {limit:.2f} %").failing
    found = advise(looking_ahead, posts=0, gate=gate_on(looking_ahead, worst)).verdict
    assert found is not None and found.tried and not found.gated
    assert "the gate passes" not in found.sentence.replace("whether the gate then passes", "")


def test_what_a_change_leaves_unknown_is_not_said_to_fail(looking_ahead: Audit) -> None:
    areas = [share.area for share in looking_ahead.shares]
    good = [sum(areas), 0.0, 0.0, 0.0]
    gate = gate_on(looking_ahead, "open > 0.1 %", "open at worst heading > 0.1 %")
    assert (gate.passes(areas), gate.passes(good)) == (False, None)
    assert gate_on(looking_ahead, "open > 0.1 %").passes(good) is True
    assert gate_on(looking_ahead, "open > 0.1 %", "free area > 1 m2").passes(good) is False
    assert gate_on(looking_ahead, "free area > 1 m2").is_fixed
    assert not gate.is_fixed
    change = Counterfactual("range", "See farther", "", 60.0, Interval(0, 0, 0, 0), (), tuple(good))
    verdict = decide(looking_ahead, 60.0, [change], gate)
    assert verdict.sentence.endswith("shows whether the gate then passes.")
    assert set(QUANTITIES) > BY_AREA | FIXED


def test_a_gate_rounds_as_the_report_does(looking_ahead: Audit) -> None:
    share = 100.0 * next(z.share for z in document(looking_ahead).zones if z.zone == "open")
    areas = [zone.area for zone in looking_ahead.shares]
    gate = gate_on(looking_ahead, f"open > {share:.2f} %")
    assert not gate.failing
    assert gate.passes(areas) is True


def test_a_good_building_may_fail_a_gate() -> None:
    shape = shapely.box(0.0, 0.0, 6.0, 4.0).difference(shapely.box(2.0, 1.0, 2.5, 1.6))
    office = examined(an.environment_from_shapes([shape], name="office"), laser(12.0))
    found = advise(office, gate=gate_on(office, "free area > 1 m2", "unreachable > 1 %")).verdict
    assert found is not None
    assert (found.decision, found.tried) == ("nothing", ())
    assert found.sentence.startswith("With test laser")
    assert found.sentence.endswith("the gate fails on other figures: free area and unreachable.")


def racks_bad(found: Audit) -> float:
    return bad_area(found.amap, found.parts.counted)


@pytest.mark.slow
def test_the_same_audit_gives_the_same_verdict(racks: Audit, advised: Audit) -> None:
    again = advise(racks, posts=0)
    assert document(again) == document(advised)


def test_of_equal_changes_the_first_one_tried_is_advised(racks: Audit) -> None:
    after = Interval(4.0, 4.0, 4.0, 0)
    equal = [Counterfactual("scanner", f"Use {k}", "", 40.0, after) for k in range(40)]
    easier = Counterfactual("range", "See farther", "", 40.0, after)
    verdict = decide(racks, 40.0, [*equal, easier], None)
    assert [change.title for change in verdict.advice] == ["See farther", "Use 0"]


def test_trips_go_around_bad_floor_where_there_is_a_way() -> None:
    """A bare corridor beside a row of alcoves: the aware path takes those."""
    alcoves = shapely.union_all([shapely.box(1.6 * k, 3.0, 1.6 * k + 1.2, 3.6) for k in range(20)])
    shape = shapely.union_all(
        [
            shapely.box(0.0, 0.0, 32.0, 1.6),
            shapely.box(0.0, 2.0, 32.0, 3.0),
            alcoves,
            shapely.box(0.0, 1.5, 1.5, 2.1),
            shapely.box(30.5, 1.5, 32.0, 2.1),
        ]
    )
    found = examined(an.environment_from_shapes([shape], name="alcoves"), laser(3.0))
    trips = find_trips(found.amap, np.random.default_rng(1))
    assert trips is not None
    assert trips.aware_bad < trips.bad
    assert trips.length <= trips.aware_length
    for path in trips.paths:
        assert shapely.covers(shape, shapely.LineString(path))


def test_trips_in_a_room_are_straight() -> None:
    found = examined(
        an.environment_from_shapes([shapely.box(0.0, 0.0, 12.0, 9.0)], name="room"), laser(20.0)
    )
    trips = find_trips(found.amap, np.random.default_rng(2))
    assert trips is not None
    assert trips.bad == trips.aware_bad == 0.0
    for path in trips.paths:
        straight = math.dist(path[0], path[-1])
        steps = float(np.hypot(*np.diff(path, axis=0).T).sum())
        # Along eight directions a path is longer by up to 1 / cos(22.5 degrees).
        assert straight - 1e-9 <= steps <= 1.0824 * straight + 1e-9


@pytest.mark.slow
def test_posts_leave_room_for_two_robots_and_the_paths_of_trips(racks: Audit) -> None:
    trips = find_trips(racks.amap, np.random.default_rng(0))
    assert trips is not None
    helps = find_posts(
        racks.environment, racks.scanner, racks.amap, racks.reach, 3, trips,
        np.random.default_rng(0),
    )  # fmt: skip
    assert helps.remedy is not None
    placed = helps.remedy.placement.placed
    assert placed
    passage = 4.0 * racks.reach.radius + 0.5
    assert helps.rules.min_passage == pytest.approx(passage)
    walls = racks.environment.free.boundary
    paths = shapely.multilinestrings([shapely.LineString(path) for path in trips.paths])
    for one in placed:
        outline = one.candidate.obstacle.outline
        assert shapely.distance(outline, paths) >= passage / 2 - 1e-6
        if not one.candidate.on_wall:
            assert shapely.distance(outline, walls) >= passage - 2e-3
    bad = np.isin(racks.amap.floor("zone").values, BAD) & racks.parts.counted
    left = [float(bad.sum()) * racks.amap.cell_area]
    for count in range(1, len(placed) + 1):
        obstacles = [one.candidate.obstacle for one in placed[:count]]
        rebuilt = an.build_map(
            racks.environment.edited(add=obstacles), racks.scanner, spacing=SPACING
        )
        still = bad & ~np.isin(rebuilt.floor("zone").values, (0, 1))
        left.append(float(still.sum()) * racks.amap.cell_area)
    assert helps.left == pytest.approx(left[1:])
    # What is said of each is of whole maps too.
    said = posts_part(helps)
    assert [post.left for post in said.posts] == pytest.approx(left[1:], abs=0.01)
    assert [post.gain for post in said.posts] == pytest.approx(-np.diff(left), abs=0.01)
    assert said.after_m2 == pytest.approx(left[-1], abs=0.01)


@pytest.mark.slow
def test_pictures_are_there_before_advice_and_an_error_in_them_ends_it(
    racks: Audit, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    seen: list[list[str]] = []

    def slow(found: Audit, go_on: object) -> Audit:
        while not (folder / "report.json").exists():
            pass
        seen.append(sorted(path.name for path in folder.iterdir()))
        return advise(found, posts=0)

    report = write_audit(racks, folder, advise=slow)
    assert "floor-zones.png" in seen[0]
    assert "report.html" not in seen[0]
    assert report.verdict is not None
    assert report.verdict.sentence in (folder / "report.html").read_text(encoding="utf-8")
    assert f"**{report.verdict.sentence}**" in (folder / "report.md").read_text(encoding="utf-8")

    def broken(*args: object) -> None:
        raise OSError("no room")

    ended: list[bool] = []

    def endless(found: Audit, go_on: object) -> Audit:
        try:
            while True:
                go_on()  # type: ignore[operator]
        finally:
            ended.append(True)

    with pytest.raises(OSError, match="no room"):
        write_audit(racks, tmp_path / "other", advise=endless, draw=broken)
    assert ended
    assert not (tmp_path / "other").exists()


def run(*arguments: str) -> tuple[int, str, str]:
    done = CliRunner().invoke(app, ["audit", *arguments])
    return done.exit_code, done.stdout, done.stderr


@pytest.mark.slow
def test_the_command_opens_with_the_verdict(tmp_path: Path) -> None:
    plan = tmp_path / "hall.wkt"
    plan.write_text("POLYGON ((0 0, 24 0, 24 3, 0 3, 0 0))")
    scanner = tmp_path / "laser.yaml"
    scanner.write_text(laser(3.0).to_yaml())
    folder = str(tmp_path / "out")
    given = [
        str(plan),
        "--scanner",
        str(scanner),
        "--spacing",
        "0.3",
        "-o",
        folder,
        "--places",
        "0",
    ]
    status, out, err = run(*given)
    assert status == 0, err
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert out.replace("\n", " ").startswith(report["verdict"]["sentence"][:60])
    assert report["verdict"]["decision"] in ("range", "scanner")
    assert f"computed. {CHOICE}\n\n- *Use a" in (tmp_path / "out" / "report.md").read_text()
    assert run(*given, "--quiet", "--no-advice") == (0, "", "")
    assert json.loads((tmp_path / "out" / "report.json").read_text())["verdict"] is None
    status, _, err = run(*given, "--posts", "2", "--no-advice")
    assert status == 2
    assert "--posts: posts are part of the advice, which --no-advice leaves out" in err
