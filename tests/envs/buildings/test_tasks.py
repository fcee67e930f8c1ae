from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav_envs.buildings.free_space import MARGIN
from ambinav_envs.buildings.tasks import draw_into, draw_task
from tests.envs.buildings.scenes import RADIUS, field_to, places_in, room, screen, state, two_rooms

PLACES = places_in(screen())


def test_drawn_tasks_are_as_far_as_asked_and_free() -> None:
    numbers = state(1)
    starts, goals = [], []
    for _ in range(200):
        task = draw_task(PLACES, numbers, 3.0, 5.0)
        assert 3.0 <= task.distance <= 5.0
        assert task.distance == pytest.approx(
            PLACES.distance(task.cost_to_go.costs, task.start[0], task.start[1]), abs=1e-6
        )
        np.testing.assert_array_equal(task.cost_to_go.costs, field_to(PLACES, *task.goal))
        assert -math.pi <= task.start[2] < math.pi
        starts.append(task.start[:2])
        goals.append(task.goal)
    ends = np.concatenate([starts, goals])
    environment = PLACES.checker.environment
    assert environment.is_free(ends[:, 0], ends[:, 1], RADIUS + MARGIN - 1e-6).all()
    # They come from everywhere, and not only from the cells' middles.
    assert len(np.unique(ends, axis=0)) == 400
    assert (ends.min(axis=0) < [1.0, 1.0]).all() and (ends.max(axis=0) > [7.0, 5.0]).all()


def test_the_same_stream_draws_the_same_task() -> None:
    first, second = (draw_task(PLACES, state(7), 1.0, 9.0) for _ in range(2))
    np.testing.assert_array_equal(first.start, second.start)
    np.testing.assert_array_equal(first.goal, second.goal)
    other = draw_task(PLACES, state(8), 1.0, 9.0)
    assert (other.start != first.start).any()


def test_start_or_goal_may_be_given() -> None:
    numbers = state(2)
    task = draw_task(PLACES, numbers, 4.0, 6.0, goal=(1.0, 1.0))
    assert task.goal.tolist() == [1.0, 1.0]
    assert 4.0 <= task.distance <= 6.0
    task = draw_task(PLACES, numbers, 4.0, 6.0, start=(1.0, 1.0, 0.5))
    assert task.start.tolist() == [1.0, 1.0, 0.5]
    assert 3.8 <= task.distance <= 6.2
    np.testing.assert_array_equal(task.cost_to_go.costs, field_to(PLACES, *task.goal))
    task = draw_task(PLACES, numbers, 4.0, 6.0, start=(1.0, 1.0, 0.5), goal=[2.0, 1.0])
    assert task.distance == pytest.approx(1.0, rel=0.03)


def test_a_path_to_a_goal_that_is_near_is_as_long_as_it_is() -> None:
    places = places_in(room())
    for off in (0.0, 0.03, 0.1, 0.33, 0.49):
        for angle in np.linspace(0.0, 6.0, 9):
            goal = (2.03 + off * math.cos(angle), 3.07 + off * math.sin(angle))
            task = draw_task(places, state(1), 0.0, 1.0, start=(2.03, 3.07, 0.0), goal=goal)
            assert task.distance == pytest.approx(off, abs=1e-12)
            # Rewards are differences of what is read from costs to go.
            read = places.distance(task.cost_to_go.costs, 2.03, 3.07)
            assert task.cost == read <= task.distance + 0.15
    # Behind a wall nothing is near.
    places = places_in(screen())
    task = draw_task(places, state(1), 0.0, 1.0, start=(3.77, 1.0, 0.0), goal=(4.23, 1.0))
    assert task.distance > 5.0


def test_far_ends_are_found_that_are_hardly_ever_drawn() -> None:
    places = places_in(room(20.0, 1.2))
    task = draw_task(places, state(3), 18.9, 30.0)
    assert task.distance >= 18.9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"goal": (0.1, 1.0)}, "goal .0.1, 1. in screen is 0.10 m from a wall"),
        ({"start": (50.0, 1.0, 0.0)}, "start .50, 1. in screen is outside of the map"),
        ({"start": (1.0, 1.0)}, "start is .1.0, 1.0.; give x, y and theta: 3 finite numbers"),
        ({"goal": (1.0, math.nan)}, "goal is .* give x and y: 2 finite numbers"),
        ({"goal": "kitchen"}, "goal is 'kitchen'"),
        ({"shortest": 5.0, "longest": 5.0}, "from 5 to 5 m"),
        ({"shortest": math.nan}, "from nan to 9 m"),
        (
            {"shortest": 50.0, "longest": 60.0},
            "screen: no start and goal are 50 to 60 m apart for a robot of 0.22 m of radius, which "
            "gets from any place at most 1[0-9].[0-9] m",
        ),
        ({"shortest": 50.0, "longest": 60.0, "goal": (1.0, 1.0)}, "gets from .1, 1. at most"),
    ],
)
def test_what_cannot_be(options: dict[str, object], words: str) -> None:
    given = {"shortest": 1.0, "longest": 9.0} | options
    with pytest.raises(an.InputError, match=words):
        draw_task(PLACES, state(1), **given)  # type: ignore[arg-type]


def test_no_way_from_one_to_the_other() -> None:
    for door in (0.0, 0.3):
        places = places_in(two_rooms(door))
        with pytest.raises(
            an.InputError, match=r"there is no path for a robot of 0.22 m of radius"
        ):
            draw_task(places, state(1), 1.0, 9.0, start=(1.0, 2.0, 0.0), goal=(7.0, 2.0))


def test_a_corner_that_is_too_tight() -> None:
    niche = shapely.affinity.rotate(shapely.box(3.9, 1.775, 6.0, 2.225), 45.0, origin=(3.9, 2.0))
    places = places_in(an.environment_from_shapes([shapely.box(0, 0, 4, 4), niche]))
    end = 1.8 * math.sqrt(0.5)
    assert places.checker.why_not(3.9 + end, 2.0 + end) is None
    with pytest.raises(an.InputError, match="in a corner so tight"):
        draw_task(places, state(1), 1.0, 9.0, goal=(3.9 + end, 2.0 + end))


def test_the_kernel_tells_how_far_it_got() -> None:
    field, task = np.empty(PLACES.room.shape, dtype=np.float32), np.empty(6)
    assert not draw_into(state(1), 50.0, 60.0, PLACES.table, field, task)
    assert 9.0 < task[5] < 12.0
