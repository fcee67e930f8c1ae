"""Why a place is ambiguous: walls of corridors by their closed form, in any frame and in space."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
import shapely
from shapely import affinity

import ambinav as an
from ambinav.geometry.extrude import extruded
from ambinav.sensing.sight import look
from ambinav.studies.audit.cause import Cause, cause_of

SCANNER = an.RangeScanner.planar(
    sensor=an.RangeSensor(max_range=3.5, std=0.01, resolution=0.01), beams=720, aperture=math.tau
)


def seen(shape: shapely.Polygon, x: float, y: float, direction: float | None) -> Cause:
    environment = an.environment_from_shapes([shape])
    return cause_of(look(environment, SCANNER, x, y, 0.3), direction)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
def test_a_corridor_is_two_walls_as_far_as_the_scanner_sees(angle: float) -> None:
    corridor = affinity.rotate(shapely.box(-20, -0.8, 20, 1.2), angle, (0, 0), use_radians=True)
    cause = seen(corridor, 0.0, 0.0, angle)
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    assert len(cause.walls) == 2
    for wall, side in zip(cause.walls, (1.2, -0.8), strict=True):
        half = math.sqrt(3.5**2 - side**2)
        assert wall.distance == pytest.approx(abs(side))
        ends = np.array([wall.start, wall.end]) @ turn.T
        assert ends[:, 1] == pytest.approx([side, side])
        # A beam more would not reach it: they are half a degree apart.
        assert ends[:, 0] == pytest.approx([-half, half], abs=0.14)
        assert (np.abs(ends[:, 0]) <= half).all()
    assert cause.sentence.startswith("Two walls run along the weak direction, 2.0 m apart, from (")
    assert cause.sentence.endswith("; no beam meets another wall within 3.5 m.")


def test_what_ends_across_is_counted() -> None:
    cause = seen(shapely.box(-20, -1, 2, 1), 0.0, 0.0, 0.0)
    # The end wall takes the beams within atan(1 / 2) of straight ahead.
    count = int(re.search(r"(\d+) of 720 beams end on another wall", cause.sentence)[1])
    assert count == pytest.approx(720 * 2 * math.atan(0.5) / math.tau, abs=1.0)
    assert "only" not in cause.sentence
    slot = shapely.box(-20, -1, 20, 1).union(shapely.box(0.5, 0.9, 0.8, 3))
    assert "only" in seen(slot, 0.0, 0.0, 0.0).sentence


def test_one_wall_and_none() -> None:
    hall = shapely.box(0, 0, 20, 20)
    cause = seen(hall, 10.0, 2.0, 0.0)
    assert [wall.distance for wall in cause.walls] == pytest.approx([2.0])
    assert cause.sentence.startswith("One wall runs along the weak direction, 2.0 m away, from (")
    assert seen(hall, 10.0, 10.0, None) == Cause((), "No beam meets a wall within 3.5 m.")
    corner = seen(hall, 3.0, 2.0, None)
    assert corner.walls == () and "the nearest wall is 2.0 m away" in corner.sentence


def test_a_wall_behind_a_scanner_is_not_denied() -> None:
    hall = an.environment_from_shapes([shapely.box(0, 0, 20, 20)])
    ahead = an.RangeScanner.planar(sensor=SCANNER.sensors[0], beams=181, aperture=math.pi)
    cause = cause_of(look(hall, ahead, 10.0, 1.0, math.pi / 2), 0.0)
    assert cause == Cause((), "No beam meets a wall within 3.5 m.")


def test_a_sliver_of_a_wall_is_no_cause() -> None:
    # The long side of a pillar ahead takes one or two of 720 beams, its short side the others.
    hall = shapely.box(0, 0, 20, 20) - shapely.box(12, 9.7, 13, 9.99)
    cause = seen(hall, 10.0, 10.0, 0.0)
    assert cause.walls == () and "the nearest wall is 2.0 m away" in cause.sentence


def test_walls_in_space_are_those_of_the_plan() -> None:
    plan = an.environment_from_shapes([shapely.box(-20, -0.8, 20, 1.2)])
    flat, solid = (
        cause_of(look(one, SCANNER.raised(0.4), 0.0, 0.0, 0.0), 0.0)
        for one in (plan, plan.in_space(extruded(plan, 2.5)))
    )
    assert flat.sentence == solid.sentence
    for mine, other in zip(flat.walls, solid.walls, strict=True):
        assert mine.start == pytest.approx(other.start, abs=1e-4)
        assert mine.end == pytest.approx(other.end, abs=1e-4)
