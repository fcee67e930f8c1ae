"""Placements are good, whatever gains do: against all subsets, and against a plain greedy."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.obstacle_file import obstacles_of
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.reach import find_reach
from ambinav.runtime.errors import InputError
from ambinav.studies.design.place.candidates import PlaceRules, apart
from ambinav.studies.design.place.document import document, enough_text
from ambinav.studies.design.place.exact import covered_most, enumerated
from ambinav.studies.design.place.greedy import NOTHING, place
from ambinav.studies.design.place.study import Remedy, place_obstacles
from ambinav.studies.design.place.submodularity import Violations, measured
from ambinav.studies.design.region import Region
from tests.drive.cases import laser, route_through

SPACING = 0.25
PASSAGE = 0.9


@pytest.fixture(scope="module")
def helped() -> Remedy:
    """Three posts in a bare hall that is wider than the scanner's range."""
    return find(posts=3, rng=np.random.default_rng(1), spacing=0.35)


def find(posts: int, rng=None, regions=(), rules=None, scanner=None, spacing=SPACING) -> Remedy:
    env = environment_from_shapes([shapely.box(0, 0, 9, 7)], name="hall")
    scanner = laser(max_range=3.0, beams=48) if scanner is None else scanner
    amap = an.build_map(env, scanner, spacing, store=False)
    rules = PlaceRules(radius=0.2, most=18) if rules is None else rules
    return place_obstacles(env, scanner, amap, rules, posts, find_reach(env, 0.2), regions, rng)


def without(helped: Remedy):
    effects = helped.placement.effects
    return type(effects)(helped.environment, effects.setting, effects.places)


@pytest.mark.sweep
def test_every_post_takes_bad_floor_away(helped: Remedy) -> None:
    placement = helped.placement
    assert len(placement.placed) == 3
    bad = [placement.before.bad, *(one.after.bad for one in placement.placed)]
    gains = [one.gain.bad for one in placement.placed]
    np.testing.assert_allclose(-np.diff(bad), gains)
    assert placement.after.bad < 0.8 * placement.before.bad
    for one, other in itertools.combinations(helped.chosen, 2):
        assert apart(one, other, PASSAGE)


@pytest.mark.slow
def test_the_figures_are_those_of_a_map_of_the_changed_building(helped: Remedy) -> None:
    after = helped.amap.update(helped.edited())
    zone = after.dataset["zone"].values
    # What a post covers stays as it was.
    zone = np.where(after.dataset["free"].values, zone, helped.amap.dataset["zone"].values)
    bad = np.isin(zone, (2, 3)) & helped.parts.counted
    assert bad.sum() * after.cell_area == pytest.approx(helped.placement.after.bad)


@pytest.mark.slow
def test_lazy_greedy_chooses_what_greedy_does(helped: Remedy) -> None:
    """Plain greedy looks at every candidate again before each choice."""
    effects, left, chosen = without(helped), list(range(len(helped.trials.candidates))), []
    for _ in range(3):
        gains = {i: effects.tried([helped.trials.candidates[i].obstacle]).gain.cost for i in left}
        best = max(gains, key=gains.__getitem__)
        one = helped.trials.candidates[best]
        effects.put(effects.tried([one.obstacle]))
        chosen.append(best)
        left = [i for i in left if i != best and apart(helped.trials.candidates[i], one, PASSAGE)]
    taken = place(without(helped), helped.trials, 3, PASSAGE)
    assert effects.badness.cost == pytest.approx(taken.after.cost, rel=0.02)


@pytest.mark.slow
def test_aged_buildings_need_a_generator(helped: Remedy) -> None:
    with pytest.raises(InputError, match="cannot be drawn without rng"):
        place_obstacles(
            helped.environment, helped.scanner, helped.amap, helped.rules, 1, helped.reach, aged=2
        )


@pytest.mark.slow
def test_pairs_are_all_tried(helped: Remedy) -> None:
    numbers = helped.trials.order[:5].tolist()
    effects = without(helped)
    found = enumerated(effects, helped.trials, numbers, 2, PASSAGE)
    gains = [
        effects.tried([helped.trials.candidates[i].obstacle for i in pair]).gain
        for pair in itertools.combinations(numbers, 2)
        if apart(*(helped.trials.candidates[i] for i in pair), PASSAGE)
    ]
    assert found is not None
    assert found.subsets == len(gains)
    assert found.best == pytest.approx(max(gains, key=lambda gain: gain.cost).bad, abs=1e-4)
    assert 0.6 < found.share <= 1.0


@pytest.mark.slow
@pytest.mark.skipif(find_spec("ortools") is None, reason="OR-Tools is not installed")
def test_the_solver_covers_as_much_as_any_pair(helped: Remedy) -> None:
    effects, trials = without(helped), helped.trials
    greedy = trials.order[:2].tolist()
    found = covered_most(effects, trials, 2, PASSAGE, greedy)
    most = max(
        effects.weights(np.union1d(trials.fixed[i], trials.fixed[j])).sum()
        for i, j in itertools.combinations(range(len(trials.candidates)), 2)
        if apart(trials.candidates[i], trials.candidates[j], PASSAGE)
    )
    assert found.covered == pytest.approx(most, abs=1e-4)
    assert found.bound == pytest.approx(most, abs=1e-2)
    assert found.greedy <= found.covered


@pytest.mark.slow
def test_gains_are_compared_by_their_definition(helped: Remedy) -> None:
    found = measured(without(helped), helped.trials, PASSAGE, np.random.default_rng(2))
    assert found.samples > 5
    grown = found.beside - found.without
    assert found.grown == (grown >= NOTHING).sum()
    assert grown[found.largest] == grown.max()
    alone = {round(gain.cost, 9) for gain in helped.trials.gains}
    assert sum(round(value, 9) in alone for value in found.without.tolist()) >= found.samples // 2


@pytest.mark.slow
def test_the_document_says_what_was_found(helped: Remedy) -> None:
    report = document(helped, 3)
    assert report.format == "ambinav-design-place/1"
    assert [one.number for one in report.obstacles] == [1, 2, 3]
    assert report.obstacles[-1].left == pytest.approx(report.after.bad)
    assert len(report.optima) == 2
    read = obstacles_of(report.geojson, "report")
    assert [one.points for one in read] == [one.drawn.points for one in helped.chosen]
    assert report.gains is not None
    grown = any("not submodular" in remark for remark in report.remarks)
    assert grown == (report.gains.grown > 0)


@pytest.mark.slow
def test_posts_that_gain_nothing_are_left_out() -> None:
    """In a room of which every corner is in sight, some posts already leave nothing bad."""
    rules = PlaceRules(radius=0.3, min_passage=0.7, most=60)
    region = Region.of_polygon(shapely.box(3.0, 2.5, 5.0, 4.0))
    found = find(6, np.random.default_rng(0), [region], rules)
    placed = found.placement.placed
    assert 0 < len(placed) < 6
    assert placed[-1].gain.bad >= NOTHING
    report = document(found, 6)
    (remark,) = (text for text in report.remarks if "suffice" in text)
    assert remark.startswith(f"{len(placed)} of 6 posts suffice")
    assert ("no bad floor is left" in remark) == (found.placement.after.bad < NOTHING)
    effects = without(found)
    for one in placed:
        effects.put(effects.tried([one.candidate.obstacle]))
    assert effects.badness == found.placement.after == found.placement.effects.badness
    if found.placement.after.bad >= NOTHING:
        gains = [effects.tried([one.obstacle]).gain.bad for one in found.trials.candidates]
        assert max(gains) < NOTHING


@pytest.mark.slow
def test_where_no_post_helps_none_is_put_up_and_no_share_is_told(
    helped: Remedy, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tags of the wall's own brightness but for one step in a thousand: nothing turns good."""
    from ambinav.sensing.intensity import Intensity

    # A tag's thickness may turn single cells.
    for module in ("study", "exact"):
        monkeypatch.setattr(f"ambinav.studies.design.place.{module}.NOTHING", 0.2)
    blind = laser(max_range=3.0, beams=48).with_intensity(
        Intensity(wall=100.0, reflector=100.1, std=60.0)
    )
    rules = PlaceRules(kind="tag", width=0.3, reflective=True, most=12)
    found = find(3, np.random.default_rng(0), rules=rules, scanner=blind)
    report = document(found, 3)
    assert report.obstacles == ()
    assert report.summary.startswith("No tag (width 0.3 m) helps")
    assert "None of 3 tags was put up: each takes away less than 0.05 m² of bad floor." in (
        report.remarks
    )
    assert [one.share for one in report.optima] == [None] * len(report.optima)
    assert all(one.share is not None for one in document(helped, 3).optima)


@pytest.mark.slow
def test_gains_are_told_in_square_metres(helped: Remedy) -> None:
    told = Violations(np.array([0.0004, 2.0, 1.0]), np.array([1.5, 1.0, 1.02]))
    assert (told.samples, told.grown) == (3, 1)
    report = document(replace(helped, violations=told), 3)
    (remark,) = (text for text in report.remarks if "submodular" in text)
    assert "in 1 of 3 samples a post gained more" in remark
    assert "at most 1.5 m² instead of 0.0 m²" in remark
    assert "%" not in remark
    assert report.gains is not None
    assert report.gains.largest is not None
    assert (report.gains.largest.without, report.gains.largest.beside) == (0.0004, 1.5)


@pytest.mark.slow
def test_a_route_is_kept_clear() -> None:
    route = route_through([(1.0, 3.5), (8.0, 3.5)])
    found = find(2, regions=[Region.of_route(route)])
    assert found.unit == "m"
    assert found.placement.before.bad <= 7.0
    assert found.placement.after.bad < found.placement.before.bad
    for one in found.chosen:
        assert one.obstacle.outline.distance(shapely.LineString(route.poses[:, :2])) >= PASSAGE / 2


@pytest.mark.slow
def test_reflectors_help_who_reads_intensities() -> None:
    from ambinav.sensing.intensity import Intensity

    plain = laser(max_range=3.0, beams=48)
    reads = plain.with_intensity(Intensity(wall=100.0, reflector=400.0, std=60.0))
    rules = PlaceRules(kind="tag", width=0.5, reflective=True, most=16)
    with pytest.raises(InputError, match="measures no intensities"):
        find(1, rules=rules)
    found = find(2, rules=rules, scanner=reads)
    assert found.placement.after.cost < found.placement.before.cost
    assert all(one.obstacle.reflective for one in found.chosen)


@pytest.mark.parametrize(("posts", "message"), [(0, "--posts: 0"), (25, "25 are requested")])
def test_more_posts_than_places(posts: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        find(posts)


def test_regions_without_floor_that_counts() -> None:
    with pytest.raises(InputError, match="be at no point"):
        find(1, regions=[Region.of_polygon(shapely.box(20, 20, 21, 21))])
    with pytest.raises(InputError, match="explored and reached"):
        find(1, regions=[Region.of_polygon(shapely.box(0, 0, 0.15, 7))])
    with pytest.raises(InputError, match="cannot be"):
        find(1, regions=[Region.of_route(route_through([(1.0, 1.0), (20.0, 1.0)]))])
    with pytest.raises(InputError, match="nothing can help"):
        find(1, scanner=laser(max_range=30.0), regions=[Region.of_polygon(shapely.box(3, 3, 5, 5))])


@pytest.mark.slow
def test_a_greedy_without_room_for_more_says_so(helped: Remedy) -> None:
    few = helped.trials.among(helped.trials.order[:2].tolist())
    placed = place(without(helped), few, 3, math.inf)
    assert placed.crowded
    assert len(placed.placed) == 1
    assert not place(without(helped), few, 1, math.inf).crowded
    known = replace(helped, placement=placed)
    assert "no further place leaves 0.9 m" in enough_text(known, 3)
    with pytest.raises(InputError, match=r"only \d of the \d+ places can be used with 8 m"):
        find(3, rules=PlaceRules(min_passage=8.0, free_standing=False, most=18))


@pytest.mark.slow
def test_the_audit_says_how_many_posts_suffice(helped: Remedy) -> None:
    from ambinav.studies.audit.post_search import PostSearch, posts_part

    part = posts_part(PostSearch(5, helped.rules, helped, "", (30.0, 20.0, 15.0)))
    assert (part.asked, len(part.posts), part.after_m2) == (5, 3, 15.0)
    assert [post.left for post in part.posts] == [30.0, 20.0, 15.0]
    assert part.reason.startswith("3 of 5 posts suffice: ")
    assert posts_part(PostSearch(3, helped.rules, helped, "", (30.0, 20.0, 15.0))).reason == ""
    none = posts_part(PostSearch(5, helped.rules, None, "No place is free."))
    assert (none.reason, none.posts, none.before_m2) == ("No place is free.", (), None)


@pytest.mark.slow
def test_no_post_stands_where_the_robot_sets_out() -> None:
    found = find(posts=1, spacing=0.35)
    (chosen,) = found.chosen
    start = tuple(chosen.middle)
    reach = find_reach(found.environment, 0.2, start=start)
    again = place_obstacles(
        found.environment, found.scanner, found.amap, found.rules, 1, reach, (), None
    )
    assert not shapely.Point(start).buffer(0.2).intersects(again.chosen[0].obstacle.outline)
