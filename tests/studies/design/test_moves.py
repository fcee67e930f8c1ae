"""Moves of obstacles, the gains that are kept, and gains in aged buildings."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.collision.reach import find_reach
from ambinav.studies.design.place.aged import gains_in_aged
from ambinav.studies.design.place.candidates import PlaceRules, apart
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.gains import Gains
from ambinav.studies.design.place.moves import FINEST, Moves
from ambinav.studies.design.place.passages import Passages
from ambinav.studies.design.place.positions import Positions
from ambinav.studies.design.place.study import Remedy, place_obstacles
from tests.drive.cases import laser

pytestmark = pytest.mark.slow  # they share maps that take seconds

PASSAGE = 0.9


@pytest.fixture(scope="module")
def hall() -> Remedy:
    """Two posts, from few candidates, in a bare hall that is wider than the scanner's range."""
    env = environment_from_shapes([shapely.box(0, 0, 14, 7)], name="hall")
    scanner = laser(max_range=3.0, beams=48)
    amap = an.build_map(env, scanner, 0.25, store=False)
    rules = PlaceRules(radius=0.2, most=10)
    return place_obstacles(env, scanner, amap, rules, 2, find_reach(env, 0.2))


def bare(hall: Remedy) -> Effects:
    effects = hall.placement.effects
    return Effects(hall.environment, effects.setting, effects.places)


def positions(hall: Remedy) -> Positions:
    effects = bare(hall)
    bad = np.column_stack(effects.setting.lattice(hall.environment)[0].points)
    bad = bad[effects.places.point[effects.bad]]
    return Positions(hall.environment, hall.rules, bad, 3.0, hall.reach.floor)


@pytest.mark.sweep
def test_no_move_on_a_fine_grid_gains(hall: Remedy) -> None:
    """Each position about each post, and the effect of all posts at once."""
    effects, found = bare(hall), positions(hall)
    cost = hall.placement.before.cost - hall.placement.after.cost
    for k, candidate in enumerate(hall.chosen):
        others = [other for i, other in enumerate(hall.chosen) if i != k]
        for rival in found.near(candidate, 1.5 * 0.19, 0.19):
            if all(apart(rival, other, PASSAGE) for other in others):
                gain = effects.tried([each.obstacle for each in (*others, rival)]).gain.cost
                # A step of this size was tried, from about here.
                assert gain < 1.03 * cost
    assert not set(hall.chosen) <= set(hall.trials.candidates)
    assert hall.placement.exchanged >= 1


@pytest.mark.sweep
def test_moves_only_ever_gain(hall: Remedy) -> None:
    effects, found = bare(hall), positions(hall)
    every, step = found.spread()
    pairs = [pair for pair in itertools.combinations(every[:4], 2) if apart(*pair, PASSAGE)]
    for pair in pairs[:2]:
        moved = Moves({"post": (found, step)}, PASSAGE).improve(Gains(effects), pair)
        before, after = (
            effects.tried([each.obstacle for each in chosen]).gain.cost for chosen in (pair, moved)
        )
        assert after >= before
        assert apart(*moved, PASSAGE)


def test_gains_are_those_of_the_whole_building(hall: Remedy) -> None:
    """Kept for the obstacles nearby alone: for a far third one, nothing is computed again."""
    effects = bare(hall)
    every, _ = positions(hall).spread()
    gains = Gains(effects)
    for first, second, third in itertools.permutations(every[:4], 3):
        now = effects.copy()
        now.put(now.tried([first.obstacle, second.obstacle]))
        expected = now.tried([third.obstacle]).gain.cost
        assert gains.beside((first, second)).gain(third) == pytest.approx(expected, abs=1e-5)
    looked = gains.looked
    gains.beside((every[0], every[1])).gain(every[2])
    assert gains.looked == looked


def test_positions_nearby_keep_the_rules(hall: Remedy) -> None:
    found, passages = positions(hall), Passages(hall.environment, PASSAGE)
    for candidate in hall.chosen:
        near = found.near(candidate, 0.5, FINEST)
        assert near
        for each in near:
            assert np.hypot(*np.subtract(each.middle, candidate.middle)) <= 0.5
            assert passages.stays(each.obstacle.outline, each.on_wall)


def test_half_of_the_candidates_are_where_most_is_bad() -> None:
    """Bad floor is a part of a long hall: there are more of the dense half than of the other."""
    env = environment_from_shapes([shapely.box(0, 0, 30, 8)], name="hall")
    bad = np.stack(np.meshgrid(np.arange(20.0, 26.0, 0.25), np.arange(1, 7, 0.25)), -1)
    found = Positions(env, PlaceRules(most=60), bad.reshape(-1, 2), 6.0, env.free)
    even, _ = found.spread_evenly(30)
    every, _ = found.spread()
    assert [each.drawn for each in every[: len(even)]] == [each.drawn for each in even]
    assert len(every) > len(even)
    inside = [20.0 <= each.middle[0] <= 26.0 for each in every[len(even) :]]
    assert len(every) <= 60
    assert np.mean(inside) > np.mean([20.0 <= each.middle[0] <= 26.0 for each in even])


def test_a_building_that_has_not_aged_gives_the_same_gain(
    hall: Remedy, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = "ambinav.studies.design.place.aged."
    monkeypatch.setattr(module + "WALL_STD", 0.0)
    obstacles = tuple(candidate.obstacle for candidate in hall.chosen)
    rng = np.random.default_rng(1)
    found = gains_in_aged(bare(hall), obstacles, 1, PASSAGE, rng)
    assert found.before == pytest.approx(hall.placement.before.bad, rel=0.02)
    total = hall.placement.before.bad - hall.placement.after.bad
    assert found.gain == pytest.approx(total, rel=0.05)


def test_aged_buildings_differ_by_the_seed_alone(hall: Remedy) -> None:
    obstacles = tuple(candidate.obstacle for candidate in hall.chosen)
    first, again, other = (
        gains_in_aged(bare(hall), obstacles, 2, PASSAGE, np.random.default_rng(seed)).gain_low
        for seed in (1, 1, 2)
    )
    assert first == again != other
    assert first > 0.0
