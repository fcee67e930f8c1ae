"""Slots of goals: shared by robots, used again, and the same arrays after the table has grown."""

from __future__ import annotations

import numpy as np

from ambinav_envs.buildings.tasks import CostToGo
from ambinav_envs.simulation.cost_to_go import CostToGoTable


def goal(value: int) -> CostToGo:
    return CostToGo(np.full((2, 3), value, np.float32), np.full((2, 3), value, np.int8))


def test_every_slot_holds_the_goal_of_its_robots() -> None:
    rng, table = np.random.default_rng(0), CostToGoTable((2, 3))
    goals = [goal(k) for k in range(20)]
    robots: dict[int, tuple[int, int]] = {}
    for _ in range(500):
        robot, which = int(rng.integers(8)), int(rng.integers(20))
        if robot in robots:
            table.release(robots.pop(robot)[1])
        robots[robot] = which, table.hold(goals[which])
        for held, slot in robots.values():
            assert (table.arrays.costs[slot] == held).all()
            assert (table.arrays.towards[slot] == held).all()
        assert len({slot for _, slot in robots.values()}) == len({k for k, _ in robots.values()})
    # Never more slots than robots, rounded up to a power of two.
    assert len(table.arrays.costs) <= 8


def test_a_goal_is_found_again_while_a_robot_drives_to_it() -> None:
    table, one, other = CostToGoTable((2, 3)), goal(1), goal(2)
    slot = table.hold(one)
    assert table.hold(one) == slot != table.hold(other)
    table.release(slot)
    assert table.hold(one) == slot
