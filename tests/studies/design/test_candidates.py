"""Where obstacles stand they close no passage: checked on a raster of where a disc fits."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from scipy import ndimage

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.reach import find_reach, reach_of, room_for
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.runtime.errors import InputError
from ambinav.studies.design.place.candidates import Candidate, PlaceRules, apart
from ambinav.studies.design.place.passages import Passages
from ambinav.studies.design.place.positions import Positions

PASSAGE = 0.9
CELL = 0.025


def building() -> Environment:
    """A hall with a pillar, and a ring corridor 1.4 m wide with a door of 1 m to the hall."""
    ring = shapely.box(0, 0, 10, 8).difference(shapely.box(1.4, 1.4, 8.6, 6.6))
    return environment_from_shapes(
        [*shapely.get_parts(ring), shapely.box(10.2, 0, 16, 8), shapely.box(9.9, 3, 10.3, 4)],
        obstacles=[shapely.box(13.0, 3.7, 13.4, 4.1)],
    )


def drawn(rules: PlaceRules, **others: object) -> tuple[Candidate, ...]:
    env = building()
    bad = np.array([[x, y] for x in range(1, 16) for y in range(8)], dtype=float)
    return Positions(env, rules, bad, 4.0, find_reach(env, 0.2).floor, **others).spread()[0]


def pieces(env: Environment, outlines: list[shapely.Polygon]) -> tuple[int, np.ndarray]:
    """Connected pieces of where a disc as wide as the passage fits, by a raster of 2.5 cm."""
    x, y = np.arange(-0.5, 16.5, CELL), np.arange(-0.5, 8.5, CELL)
    grid = np.meshgrid(x, y)
    room = shapely.contains_xy(env.free.difference(shapely.union_all(outlines)), *grid)
    wide = ndimage.distance_transform_edt(room) * CELL >= PASSAGE / 2
    label, count = ndimage.label(wide, structure=np.ones((3, 3)))
    sizes = ndimage.sum_labels(wide, label, np.arange(1, count + 1))
    return int((sizes * CELL**2 > 0.05).sum()), wide


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["post", "panel"])
def test_no_candidate_closes_a_passage(kind: str) -> None:
    env = building()
    before, _ = pieces(env, [])
    found = drawn(PlaceRules(kind=kind, most=60))
    assert {one.on_wall for one in found} == {True, False}
    for one in found[::8]:
        # Round the ring there is a second way: it is cut here, so that closing one shows.
        cut = shapely.box(4.9, -0.1, 5.0, 1.5)
        far = one.obstacle.outline.distance(cut) > 1.5
        outlines = [one.obstacle.outline, *([cut] if far else [])]
        assert pieces(env, outlines)[0] == before, one.drawn


def test_a_corridor_is_not_closed_though_there_is_another_way_round() -> None:
    passages = Passages(building(), PASSAGE)
    assert passages.stays(Obstacle.post(5.0, 0.08, 0.1).outline, True)  # 1.22 m are left
    assert not passages.stays(Obstacle.post(5.0, 0.25, 0.3).outline, True)  # 0.85 m are left
    assert not passages.stays(Obstacle.panel(5.0, 0.0, 5.0, 0.6, 0.04).outline, True)
    assert not passages.stays(Obstacle.post(10.1, 3.05, 0.1).outline, True)  # 0.85 m of the door
    # Between the wall and the pillar, 3.6 m apart, an arm of 1 m leaves room, one of 3 m does not.
    assert passages.stays(Obstacle.panel(13.2, 8.0, 13.2, 7.0, 0.04).outline, True)
    assert not passages.stays(Obstacle.panel(13.2, 8.0, 13.2, 4.5, 0.04).outline, True)


def test_free_standing_obstacles_keep_off_walls_and_each_other() -> None:
    env = building()
    rules = PlaceRules(radius=0.15, on_walls=False)
    found = drawn(rules)
    assert all(not one.on_wall for one in found)
    walls = shapely.union_all([env.free.boundary])
    off = min(one.obstacle.outline.distance(walls) for one in found)
    assert PASSAGE - 1e-3 <= off < PASSAGE + 0.3
    first = found[0]
    for other in found[1:20]:
        gap = first.obstacle.outline.distance(other.obstacle.outline)
        assert apart(first, other, PASSAGE) == (gap > PASSAGE)


@pytest.mark.slow
def test_tags_are_flat_on_walls() -> None:
    env = building()
    found = drawn(PlaceRules(kind="tag", width=0.4, reflective=True))
    assert found
    assert all(one.on_wall and one.drawn.kind == "reflector" for one in found)
    for one in found:
        ends = shapely.points(one.drawn.points)
        assert shapely.distance(ends, env.free.boundary).max() < 0.02
        assert one.angle == pytest.approx(0.0, abs=0.1) or one.angle == pytest.approx(
            math.pi / 2, abs=0.1
        )


@pytest.mark.slow
def test_nothing_stands_on_a_frontier_or_on_a_route() -> None:
    env = environment_from_shapes(
        [shapely.box(0, 0, 8, 4)], openings=[shapely.LineString([(0, 0), (8, 0)])]
    )
    bad = np.array([[4.0, 2.0]])
    line = shapely.LineString([(0.5, 2.0), (7.5, 2.0)])
    floor = room_for(env, 0.2)
    for routes in ((), (line,)):
        found, _ = Positions(env, PlaceRules(), bad, 4.0, floor, routes).spread()
        heights = np.array([one.middle[1] for one in found])
        assert heights.min() > 0.5
        near = np.array([one.obstacle.outline.distance(line) for one in found])
        assert (near.min() >= PASSAGE / 2 - 1e-9) == bool(routes)


def test_candidates_are_as_many_as_asked_and_always_the_same() -> None:
    few = drawn(PlaceRules(most=20))
    assert 5 <= len(few) <= 20
    assert [one.drawn for one in few] == [one.drawn for one in drawn(PlaceRules(most=20))]


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        ({"radius": -0.1}, "--radius: -0.1"),
        ({"radius": 0.5}, "not narrower than the passage"),
        ({"width": 0.0}, "--width: 0"),
        ({"min_passage": -1.0}, "--min-passage: -1"),
        ({"min_passage": math.nan}, "min_passage"),
        ({"most": 0}, "--candidates: 0"),
        ({"kind": "tag", "on_walls": False}, "flat on a wall"),
    ],
)
def test_rules_that_cannot_be(rules: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PlaceRules(**rules)


def test_no_place_is_said() -> None:
    with pytest.raises(InputError, match="fits nowhere"):
        drawn(PlaceRules(radius=0.3, min_passage=4.0, on_walls=False))
    env = building()
    with pytest.raises(InputError, match="nothing can help"):
        Positions(env, PlaceRules(), np.empty((0, 2)), 4.0, room_for(env, 0.2))


@pytest.mark.slow
def test_a_corridor_narrower_than_the_passage_stays_open_for_the_robot() -> None:
    halls = [shapely.box(-3, -2, 0, 2), shapely.box(0, 0, 14, 0.8), shapely.box(14, -2, 17, 2.5)]
    env, bad = environment_from_shapes(halls), np.array([[2.0, 0.4], [7.0, 0.4], [12.0, 0.4]])
    reach, rules = find_reach(env, 0.2), PlaceRules(kind="panel", most=20)
    least = {}
    for radius in (0.0, reach.radius):
        places, _ = Positions(env, rules, bad, 4.0, reach.floor, robot_radius=radius).spread()
        edited = [env.edited(add=[place.obstacle]) for place in places]
        least[radius] = min(reach_of(each, 0.2).floor.area for each in edited)
    assert least[0.0] < reach.floor.area - 5.0
    assert least[reach.radius] > reach.floor.area - 0.6


@pytest.mark.parametrize("kind", ["post", "panel", "tag"])
def test_few_candidates_are_some(kind: str) -> None:
    env, floor = environment_from_shapes([shapely.box(0, 0, 12, 12)]), shapely.box(1, 1, 11, 11)
    bad = np.array([[4.0, 4.0], [8.0, 4.0], [4.0, 8.0], [8.0, 8.0]])
    for most in (1, 2, 3, 5, 10):
        rules = PlaceRules(kind=kind, most=most, on_walls=kind == "tag")
        places, _ = Positions(env, rules, bad, 4.0, floor).spread()
        assert 1 <= len(places) <= most


@pytest.mark.slow
def test_more_pillars_than_candidates_have_candidates_on_some() -> None:
    pillars = [
        shapely.box(x, y, x + 1.5, y + 1.5) for x in range(2, 60, 4) for y in range(2, 60, 4)
    ]
    env = environment_from_shapes([shapely.box(0, 0, 62, 62)], obstacles=pillars)
    bad = np.stack(np.meshgrid(np.arange(1.0, 62, 2), np.arange(1.0, 62, 2)), axis=-1).reshape(
        -1, 2
    )
    rules = PlaceRules(kind="tag", width=0.3, most=200)
    places, _ = Positions(env, rules, bad, 10.0, env.free).spread_evenly(200)
    on_pillars = [min(x, y, 62 - x, 62 - y) > 1.0 for x, y in (each.middle for each in places)]
    assert 100 <= len(places) <= 200 and sum(on_pillars) > 60


@pytest.mark.parametrize("width", [0.404, 0.41, 0.914])
def test_necks_hardly_wider_than_the_passage_stay_open(width: float) -> None:
    rooms = [shapely.box(0, 0, 4, 4), shapely.box(6, 0, 10, 4)]
    env = environment_from_shapes([*rooms, shapely.box(4, 2 - width / 2, 6, 2 + width / 2)])
    kept = 0.4 if width < 0.9 else 0.9
    passages, whole = Passages(env, kept), find_reach(env, kept / 2 - 1e-3).floor.area
    posts = [
        Obstacle.post(x, 2 - width / 2 + y, 0.1) for x in (3.92, 4.0, 5.0) for y in (-0.08, 0.02)
    ]
    for post in posts:
        left = reach_of(env.edited(add=[post]), kept / 2 - 1e-3).floor.area
        assert left > 0.9 * whole or not passages.stays(post.outline, True)


def test_a_kind_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="kind is 'posts'; choose from post, panel, tag"):
        PlaceRules(kind="posts")  # type: ignore[arg-type]
