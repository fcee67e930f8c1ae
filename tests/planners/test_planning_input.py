"""What cannot be planned: the messages say what is wrong, where, and what to do."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from ambinav_planners import NoPathError, NotFoundError, RoutePlanner, plan, planners
from ambinav_planners.registry import Budget
from tests.planners.conftest import LASER

START, GOAL = (3.0, 3.0), (42.0, 20.0)
LEFT, RIGHT = (1.0, 1.0), (8.0, 2.0)


@pytest.fixture(scope="module")
def two_rooms() -> AmbiguityMap:
    """Two rooms without a door; the left one ends in unknown space on its right side."""
    environment = an.environment_from_shapes(
        [shapely.box(0, 0, 4, 4), shapely.box(6, 0, 9, 4)],
        openings=[shapely.LineString([(4, 1), (4, 3)])],
        name="two rooms",
    )
    scanner = an.RangeScanner.planar(sensor=LASER, beams=36, aperture=2.0 * math.pi)
    return an.build_map(environment, scanner, spacing=0.25)


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("aorrtc", "never calls the objective"),
        ("prm", "deadlocks with an objective written in Python"),
        ("PRM", "deadlocks"),
        ("rrt", "stops at the first path"),
        ("rrtconnect", "stops at the first path"),
        ("RRT-Connect", "stops at the first path"),
        ("kpiece1", "stops at the first path"),
        ("lbkpiece1", "stops at the first path"),
    ],
)
def test_refused_planners(robot: RoutePlanner, name: str, reason: str) -> None:
    with pytest.raises(InputError) as caught:
        robot.plan(START, GOAL, planner_name=name)
    message = str(caught.value)
    assert message.startswith(f"planner {name!r} is refused: ")
    assert reason in message
    assert all(other in message for other in planners())


def test_unknown_planners(robot: RoutePlanner) -> None:
    for name, close in (("rrtstarr", "rrtstar"), ("RRTstar", "rrtstar"), ("inform", "informed")):
        with pytest.raises(InputError, match=f"there is no planner '{name}'; did you mean {close}"):
            robot.plan(START, GOAL, planner_name=name)
    with pytest.raises(InputError, match=r"there is no planner 'xy'; choose from belief, .*\.$"):
        robot.plan(START, GOAL, planner_name="xy")


@pytest.mark.parametrize(
    ("budget", "message"),
    [
        ({"seconds": 0.0}, "seconds is 0.0; give a number above 0"),
        ({"seconds": -1.0}, "seconds is -1.0"),
        ({"seconds": math.nan}, "seconds is nan"),
        ({"seconds": "1"}, "seconds is '1'; give a number above 0"),
        ({"seconds": 1.0, "iterations": 0}, "iterations is 0"),
        ({"seconds": 1.0, "iterations": 1.5}, "iterations is 1.5; give a whole number"),
        ({"seconds": 1.0, "seed": -1}, "seed is -1; give a whole number from 0"),
        ({"seconds": 1.0, "seed": -3}, "seed is -3"),
        ({"seconds": 1.0, "seed": 2**32 - 1}, "seed is 4294967295"),
        ({"seconds": 1.0, "seed": 1.5}, "seed is 1.5"),
    ],
)
def test_budgets(robot: RoutePlanner, budget: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        Budget(**budget)  # type: ignore[arg-type]
    with pytest.raises(InputError, match=re.escape(message)):
        robot.plan(START, GOAL, **budget)  # type: ignore[arg-type]


def test_something_must_end_a_planner(robot: RoutePlanner) -> None:
    with pytest.raises(InputError, match="neither time nor iterations"):
        robot.plan(START, GOAL, planner_name="bitstar", seconds=math.inf)
    # The reference takes the time that it takes.
    assert robot.plan(START, (4.0, 3.0), planner_name="reference", seconds=math.inf).length < 1.1


@pytest.mark.parametrize("name", ["prmstar", "fmt", "bitstar", "reference"])
def test_iterations_alone_are_a_budget(robot: RoutePlanner, name: str) -> None:
    route = robot.plan(
        START, (4.0, 3.0), planner_name=name, seconds=math.inf, iterations=np.int64(300)
    )
    assert route.length == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("name", ["prmstar", "fmt", "bfmt", "rrtstar", "bitstar"])
def test_a_budget_that_is_too_small(robot: RoutePlanner, name: str) -> None:
    with pytest.raises(NotFoundError, match=f"planner '{name}' found no path .*in 1e-09 s"):
        robot.plan(START, GOAL, planner_name=name, seconds=1e-9)
    if planners()[name].iteration != "samples" or name == "rrtstar":  # FMT* samples on by itself
        with pytest.raises(NotFoundError, match=f"planner '{name}' found no path .*in 3 "):
            robot.plan(START, GOAL, planner_name=name, iterations=3)


def test_a_planner_that_finds_nothing_says_what_a_route_costs_at_least(robot: RoutePlanner) -> None:
    best = robot.plan(START, GOAL).cost
    with pytest.raises(NotFoundError, match=r"No route costs less than \d+\.\d\d\.") as caught:
        robot.plan(START, GOAL, planner_name="prmstar", seconds=1e-9)
    assert 0.97 * best < caught.value.bound <= best


BAD_ENDS = {
    "outside": ((-50.0, 3.0), r"outside of the map, which reaches from .*nearest.*\d\.\d\d m away"),
    "not a number": ((3.0, math.nan), r"is \(3\.0, nan\); give x and y in metres\.$"),
    "no heading": ((3.0, 3.0, math.nan), r"3\.0, nan\); give x and y in metres, and a heading in"),
    "infinite": ((math.inf, 3.0), r"is \(inf, 3\.0\)"),
    "one number": ((3.0,), r"is \(3\.0,\)"),
    "four numbers": ((3.0, 3.0, 0.0, 0.0), r"give x and y in metres"),
    "no numbers": (("three", 3.0), r"is \('three', 3\.0\); give x and y in metres"),
}


@pytest.mark.parametrize(("place", "message"), BAD_ENDS.values(), ids=BAD_ENDS.keys())
def test_bad_ends(robot: RoutePlanner, place: tuple[float, ...], message: str) -> None:
    for name, ends in (("start", (place, GOAL)), ("goal", (START, place))):
        with pytest.raises(InputError, match=message) as caught:
            robot.plan(*ends)
        assert str(caught.value).startswith(f"{name} ")


def test_ends_in_walls_and_behind_them(two_rooms: AmbiguityMap) -> None:
    for place, message in (
        (
            (4.05, 0.5),
            r"is in a wall, 0\.05 m deep; the nearest free point is \(3\.80, 0\.50\), 0\.25 m away",
        ),
        ((5.0, 0.5), r"is behind a wall, 1\.00 m from the free space"),
        ((3.9, 0.5), r"is 0\.10 m from a wall, the footprint needs 0\.2 m; .*, 0\.10 m away"),
    ):
        with pytest.raises(InputError, match=message):
            plan(two_rooms, LEFT, place)


def test_the_nearest_free_point_is_named_in_round_numbers(two_rooms: AmbiguityMap) -> None:
    # The nearest place stands a robot's radius from both walls, and so does no rounded one.
    robot = RoutePlanner(two_rooms, footprint=0.2 + 1e-9)
    with pytest.raises(
        InputError, match=r"the nearest free point is \(0\.2\d, 0\.2\d\),"
    ) as caught:
        robot.plan((0.0, 0.0), (3.0, 3.0))
    found = re.search(r"point is \(([\d.]+), ([\d.]+)\)", str(caught.value))
    assert found is not None
    assert robot.plan((float(found[1]), float(found[2])), (3.0, 3.0), planner_name="reference")


def test_a_footprint_is_a_radius_or_an_outline(two_rooms: AmbiguityMap) -> None:
    with pytest.raises(InputError, match=r"footprint is \[\(0.3, 0.2\)\]; give a radius"):
        RoutePlanner(two_rooms, footprint=[(0.3, 0.2)])  # type: ignore[arg-type]


def test_ends_in_unknown_space(two_rooms: AmbiguityMap) -> None:
    with pytest.raises(InputError, match=r"goal \(4\.3, 2\) is in unknown space; the nearest free"):
        plan(two_rooms, LEFT, (4.3, 2.0))
    with pytest.raises(
        InputError, match=r"is 0\.10 m from unknown space, the footprint needs 0\.2"
    ):
        plan(two_rooms, LEFT, (3.9, 2.0))


def test_a_robot_that_fits_nowhere(two_rooms: AmbiguityMap) -> None:
    with pytest.raises(InputError, match="no other place in this building is free for the robot"):
        plan(two_rooms, LEFT, (3.0, 3.0), footprint=2.5)


@pytest.mark.parametrize("name", ["prmstar", "reference", "rrtstar", "fmt", "belief"])
def test_no_way(two_rooms: AmbiguityMap, name: str) -> None:
    with pytest.raises(NoPathError, match=r"no path leads .* \(1, 1\) .* \(8, 2\)") as caught:
        plan(two_rooms, LEFT, RIGHT, planner=name, seconds=0.2)
    check_labels(two_rooms, caught.value)


@pytest.mark.parametrize("space", ["se2", "dubins"])
def test_no_way_in_other_spaces(two_rooms: AmbiguityMap, space: str) -> None:
    radius = 0.5 if space == "dubins" else 0.0
    with pytest.raises(NoPathError) as caught:
        plan(two_rooms, LEFT, RIGHT, space=space, turning_radius=radius, seconds=0.2)
    check_labels(two_rooms, caught.value)


def check_labels(amap: AmbiguityMap, error: NoPathError) -> None:
    x, y = np.meshgrid(amap.dataset["x"].values, amap.dataset["y"].values)
    fits = np.asarray(amap.environment.is_free(x, y, 0.2))
    assert error.labels.shape == x.shape
    assert error.start_label != error.goal_label
    assert ((error.labels == error.start_label) == (fits & (x < 5))).all()
    assert ((error.labels == error.goal_label) == (fits & (x > 5))).all()
    assert (error.labels[~fits] == -1).all()
    areas = [float(part) for part in re.findall(r"([\d.]+) m\^2", str(error))]
    assert areas == pytest.approx([12.96, 9.36], rel=0.15)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"one_way": 1}, "one_way is 1; give an instance of OneWayLanes"),
        ({"route_graph": "g.json"}, "route_graph is 'g.json'; give an instance of RouteGraph"),
        ({"belief": 1}, "belief is 1; give an instance of BeliefModel"),
        ({"odometry": "poor"}, "odometry is 'poor'; give an instance of OdometryNoise"),
    ],
)
def test_arguments_of_another_kind(demo: AmbiguityService, options: Any, message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        RoutePlanner(demo, **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weight": -1.0}, "weight is -1.0; give a number of at least 0"),
        ({"weight": math.nan}, "weight is nan"),
        ({"max_bad_metres": 0.0}, "max_bad_metres is 0.0; give metres above 0"),
        ({"max_bad_metres": math.nan}, "max_bad_metres is nan"),
        ({"max_bad_metres": "far"}, "max_bad_metres is 'far'; give a finite number"),
        ({"planner": 3}, "planner is 3; give one of"),
        ({"keep_out": "zones.geojson"}, "keep_out is 'zones.geojson'; give a shapely geometry"),
        ({"max_bad_metres": 1.0, "bad_level": -1.0}, "bad_level is -1.0"),
        ({"space": "r3"}, "space is 'r3'; choose from r2, se2, dubins, reeds-shepp"),
        ({"space": "dubins"}, "dubins needs a turning radius above 0"),
        ({"turning_radius": 1.0}, "r2 turns on the spot"),
        ({"footprint": -0.1}, "radius is -0.1"),
        ({"space": "se2", "planner": "reference"}, "does not plan in se2; it knows r2"),
        ({"space": "dubins", "turning_radius": 1.0, "planner": "rrtstar"}, "not plan in dubins"),
        ({"space": "dubins", "turning_radius": 1.0, "planner": "fmt"}, "not plan in dubins"),
    ],
)
def test_bad_options(demo: AmbiguityService, options: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        plan(demo, START, GOAL, **options)  # type: ignore[arg-type]


def test_a_missing_layer(demo_map: AmbiguityMap) -> None:
    with pytest.raises(InputError, match=r"'levels'.*level"):
        AmbiguityService(demo_map, "levels")


@pytest.mark.slow
def test_a_point_is_a_robot_too(robot: RoutePlanner) -> None:
    """The narrower the robot, the shorter its way, down to a point."""
    lengths = [
        RoutePlanner(robot.service.map, footprint=radius).plan((3, 3), (20, 3), weight=0.0).length
        for radius in (0.0, 0.05, 0.2)
    ]
    assert lengths[0] < lengths[1] < lengths[2]
