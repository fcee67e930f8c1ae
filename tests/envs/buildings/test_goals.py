from __future__ import annotations

import math

import numpy as np
import pytest

import ambinav as an
from ambinav_envs.buildings.free_space import MARGIN
from ambinav_envs.buildings.goals import MOST, Goals
from tests.envs.buildings.scenes import RADIUS, field_to, places_in, room, screen, state

PLACES = places_in(screen())


def test_goals_are_shared_and_starts_are_not() -> None:
    goals, numbers = Goals(PLACES), state(1)
    tasks = [goals.draw(numbers, 2.0, 6.0) for _ in range(3000)]
    places = np.array([task.goal for task in tasks])
    assert len(np.unique(places, axis=0)) == MOST
    assert len(np.unique([task.start for task in tasks], axis=0)) == len(tasks)
    free = PLACES.checker.environment.is_free
    assert free(places[:, 0], places[:, 1], RADIUS + MARGIN - 1e-6).all()
    for task in tasks[:50]:
        assert 2.0 <= task.distance <= 6.0 and -math.pi <= task.start[2] < math.pi
        assert task.distance == pytest.approx(
            PLACES.distance(task.cost_to_go.costs, task.start[0], task.start[1]), abs=1e-6
        )
        np.testing.assert_array_equal(task.cost_to_go.costs, field_to(PLACES, *task.goal))
    same = [task.cost_to_go.costs for task in tasks if (task.goal == tasks[0].goal).all()]
    assert len(same) > 1 and all(field is same[0] for field in same)


def test_a_task_hangs_on_the_stream_and_not_on_what_was_drawn_before() -> None:
    used = Goals(PLACES)
    for seed in range(20):
        used.draw(state(seed), 2.0, 6.0)
    first, second = (goals.draw(state(99), 2.0, 6.0) for goals in (used, Goals(PLACES)))
    np.testing.assert_array_equal(first.start, second.start)
    np.testing.assert_array_equal(first.goal, second.goal)
    assert first.distance == second.distance


def test_goals_of_no_use_are_drawn_from_anywhere() -> None:
    # Only from end to end is it far enough.
    task = Goals(places_in(room(20.0, 1.2))).draw(state(3), 18.9, 30.0)
    assert task.distance >= 18.9
    with pytest.raises(an.InputError, match="no start and goal are 50 to 60 m apart"):
        Goals(PLACES).draw(state(1), 50.0, 60.0)
    with pytest.raises(an.InputError, match="from 5 to 5 m"):
        Goals(PLACES).draw(state(1), 5.0, 5.0)


def test_the_way_to_take_is_the_cheapest_one() -> None:
    # On the left of an empty room a metre costs ten.
    places = places_in(room(8.0, 6.0))
    x = places.origin[0] + places.spacing * np.arange(places.room.shape[1])
    prices = np.ones((*places.room.shape, 1), dtype=np.float32)
    prices[:, x < 4.0] = 10.0
    dear, plain = Goals(places, prices), Goals(places)
    for seed in range(20):
        task, short = dear.draw(state(seed), 2.0, 6.0), plain.draw(state(seed), 2.0, 6.0)
        np.testing.assert_array_equal(task.start, short.start)
        assert task.distance == short.distance == short.cost
        both = task.start[0], task.goal[0]
        if min(both) > 4.5:
            assert task.cost == pytest.approx(task.distance, rel=1e-6)
        elif max(both) < 3.5:
            # Up to the edge and back may be cheaper; straight on it is ten times as much.
            assert 1.0 < task.cost / task.distance <= 10.0 + 1e-3
        else:
            # The last half metre is priced where it begins.
            dear_metres = max(4.0 - min(both) - 0.6, 0.0)
            assert task.cost >= task.distance + 9.0 * dear_metres - 1e-3
    given = plain.draw(state(3), 2.0, 6.0)
    again = dear.towards(given)
    assert again is not None
    assert again.distance == given.distance and again.cost >= given.cost
