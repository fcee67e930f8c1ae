"""Wrong arguments to the Python API: one sentence that says what to give instead."""

from __future__ import annotations

import copy
import math
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

import ambinav as an
import ambinav_planners as planners
from ambinav.plugin import LOCALIZERS

LASER = an.RangeSensor(max_range=3.0, std=0.03, resolution=0.01)
SCANNER = an.RangeScanner.planar(LASER, 12, math.tau)
ROOM = an.environment_from_shapes(rooms=[[(0, 0), (6, 0), (6, 4), (0, 4)]], name="room")
ROUTE = an.Route.through([(1, 1), (3, 1)])
POSES = np.array([[1.0, 1.0, 0.0], [3.0, 1.0, 0.0]])
RNG = np.random.default_rng(1)
POST = an.Obstacle.post(3, 3, 0.1)
AMAP = an.build_map(ROOM, SCANNER, spacing=0.5, store=False)
SERVICE = an.AmbiguityService(AMAP)
ROBOT = an.Robot()


class Still:
    """A controller that returns what it is made with."""

    def __init__(self, command: Any) -> None:
        self._command = command

    def command(self, *state: Any) -> Any:
        return self._command


def drive(localizer: Any = "perfect", **given: Any) -> object:
    arguments = {"environment": ROOM, "scanner": SCANNER, "robot": ROBOT, "route": ROUTE, **given}
    return an.drive_route(**arguments, localizer=localizer, rng=RNG, runs=2)


def cut(mesh: Any = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)), faces: Any = ()) -> object:
    return an.Mesh(mesh, faces)


FLOOR = an.find_reach(ROOM, 0.2)
RULES = an.PlaceRules()
ANY: Any = None  # so that a type checker accepts what is wrong on purpose

CASES: tuple[tuple[str, Callable[[], object], str], ...] = (
    ("a path for a store", lambda: an.build_map(ROOM, SCANNER, 0.5, store=ANY or "x"), "MapStore"),
    ("a path for a dataset", lambda: an.AmbiguityMap(ANY or "a.zarr"), "AmbiguityMap.open"),
    ("no name of a layer", lambda: AMAP.sample(ANY, 1, 1), "no such layer"),
    ("a small mask", lambda: AMAP.centres(np.ones((2, 2), dtype=bool)), "(2, 2)"),
    ("a radius for a reach", lambda: AMAP.for_robot(ANY or 0.2), "find_reach"),
    ("a radius for trips", lambda: an.find_lost_routes(AMAP, ROOM, ANY or 0.2), "find_reach"),
    (
        "a radius for posts",
        lambda: an.place_obstacles(ROOM, SCANNER, AMAP, RULES, 1, ANY or 0.2),
        "find_reach",
    ),
    ("a map for a building", lambda: an.find_reach(ANY or AMAP, 0.2), "instance of Environment"),
    ("a pose as start", lambda: an.find_reach(ROOM, 0.2, (1, 1, 0)), "(1, 1, 0)"),
    ("a map to scan in", lambda: SCANNER.scan(ANY or AMAP, 1, 1, 0), "load_environment"),
    ("no sensor", lambda: an.RangeScanner.planar(ANY or "x", 3, 1.0), "instance of RangeSensor"),
    ("a list of scanners", lambda: an.RangeScanner.mixed(ANY or [SCANNER]), "RangeScanner"),
    ("a mapping for a channel", lambda: SCANNER.with_intensity(ANY or {}), "instance of Intensity"),
    ("a seed for a generator", lambda: LASER.read(1.0, ANY or 1), "default_rng"),
    (
        "readings of one beam",
        lambda: an.read_intensity(SCANNER, ROOM, 1, 1, 0, ANY or [1.0], RNG),
        "(1,)",
    ),
    ("a building for a map", lambda: an.AmbiguityService(ANY or ROOM), "instance of AmbiguityMap"),
    ("unlike poses", lambda: SERVICE.motion_costs(POSES[:1], POSES, an.Steering()), "(1, 3)"),
    (
        "points for poses",
        lambda: SERVICE.motion_costs(POSES[:, :2], POSES[:, :2], an.Steering()),
        "(N, 3)",
    ),
    ("a route for poses", lambda: SERVICE.route_cost(ANY or ROUTE), "(N, 3)"),
    ("the name of a space", lambda: an.Route.through(POSES, ANY or "r2"), "instance of Steering"),
    (
        "a map for a service",
        lambda: an.evaluate_route(ANY or AMAP, POSES, an.Steering(), planner="x"),
        "AmbiguityService",
    ),
    (
        "poses for a route",
        lambda: an.save_route(ANY or POSES.tolist(), "r.csv"),
        "instance of Route",
    ),
    ("a robot for limits", lambda: ROUTE.timed(ANY or ROBOT), "instance of SpeedLimits"),
    ("half a stop", lambda: ROUTE.timed(stops=[ANY or 0.5]), "stops"),
    (
        "times in two axes",
        lambda: an.speed_profile(POSES, an.Steering()).at(np.zeros((1, 2))),
        "(1, 2)",
    ),
    (
        "a radius for a footprint",
        lambda: an.CollisionChecker(ROOM, ANY or 0.2, an.Steering()),
        "Footprint.disc",
    ),
    ("a scanner by name", lambda: drive(scanner="turtlebot3-lds"), "instance of RangeScanner"),
    ("odometry by name", lambda: drive(noise="mediocre"), "instance of OdometryNoise"),
    ("a number of people", lambda: drive(people=3), "instance of People"),
    ("a radius for a robot", lambda: drive(robot=0.2), "instance of Robot"),
    ("a class by name", lambda: drive("product"), "LocalizerClass.load(NAME).chosen"),
    ("a class", lambda: drive(an.LocalizerClass.load("product")), "chosen(scanner, noise)"),
    ("a command for one robot", lambda: drive(controller=Still([0.1, 0.0])), "shape (2, 2)"),
    ("a command of nothing", lambda: drive(controller=Still(None)), "shape (2, 2)"),
    (
        "a command that is not finite",
        lambda: drive(controller=Still(np.full((2, 2), np.nan))),
        "finite",
    ),
    (
        "odometry by name, for runs",
        lambda: an.EnsembleRunner(ROOM, SCANNER, "mcl", noise=ANY or "good"),
        "OdometryNoise",
    ),
    ("a service to forecast on", lambda: an.forecast(ANY or SERVICE, ROUTE), "AmbiguityMap"),
    ("a path for a place", lambda: an.expected_covariance(ANY or "x", POSES), "AmbiguityMap"),
    (
        "noise for a model",
        lambda: an.information_gain(AMAP, None, POSES, np.eye(3), ANY or an.OdometryNoise()),
        "instance of OdometryModel",
    ),
    ("no mapping", lambda: an.MclParameters.from_dict(ANY), "mapping"),
    (
        "unlike odometry",
        lambda: an.OdometryModel().moved(POSES, np.zeros((3, 3)), (1, 0, 0)),
        "broadcast",
    ),
    ("odometry every 0 m", lambda: an.OdometryNoise().modelled_every(0.0, 0.1), "above 0"),
    ("four corners of a face", lambda: cut(faces=[[0, 1, 2, 3]]), "(1, 4)"),
    ("points in a plane", lambda: cut([[0, 0], [1, 0], [1, 1]], [[0, 1, 2]]), "(3, 2)"),
    ("no solid", lambda: an.Prisms(solids=[ANY or shapely.box(0, 0, 1, 1)]), "instance of Solid"),
    (
        "an origin in the plane",
        lambda: an.extruded(ROOM, 2.0).cast((1, 1), (1, 0, 0), 5.0),
        "broadcast",
    ),
    ("turned by nan", lambda: ROOM.transformed(math.nan), "angle is nan"),
    ("an empty box", lambda: ROOM.window((3, 3, 1, 1)), "xmin"),
    ("a negative number of posts", lambda: an.advise(ANY, posts=-1), "posts"),
    (
        "drawn as gif",
        lambda: an.write_audit(an.audit(AMAP, ROOM, SCANNER), "x", image_format="gif"),
        "png",
    ),
    (
        "a scenario by its file",
        lambda: an.compare_routes(ANY or Path("a.yaml"), "x"),
        "load_scenario",
    ),
    (
        "a mapping of options",
        lambda: an.export_map(AMAP, "npz", "a.npz", ANY or {"a": 1}),
        "ExportOptions",
    ),
    ("a building to plan in", lambda: planners.RoutePlanner(ANY or ROOM), "AmbiguityService"),
    (
        "a service for a robot",
        lambda: planners.pareto(ANY or SERVICE, (1, 1), (3, 1)),
        "RoutePlanner",
    ),
    (
        "a pair without a node",
        lambda: planners.RouteGraph.numbered("graph", [[1, 1], [3, 1]], [[0, 2]]),
        "names none of the 2 nodes",
    ),
    ("a map in space", lambda: an.VolumeService(ANY or AMAP), "AmbiguityVolume"),
)


@pytest.mark.parametrize("case", CASES, ids=[case[0] for case in CASES])
def test_a_wrong_argument_is_refused_in_a_sentence(
    case: tuple[str, Callable[[], object], str],
) -> None:
    _, call, part = case
    with pytest.raises(an.InputError) as error:
        call()
    message = str(error.value)
    assert part in message
    assert message.endswith(".") and "\n" not in message


def test_lists_will_do() -> None:
    poses = POSES.tolist()
    assert SERVICE.motion_costs(poses, poses, an.Steering()).tolist() == [0.0, 0.0]
    cells = an.CollisionChecker(
        ROOM, an.Footprint.disc(0.1), an.Steering(), forbidden=ANY or [[True]], origin=(1, 1)
    )
    assert cells.poses_free(poses).tolist() == [False, True]
    graph = planners.RouteGraph.numbered("graph", [[1, 1], [3, 1]], [[0, 1]])
    assert graph.pairs.dtype == np.int32


def test_equal_values_are_equal_after_a_copy() -> None:
    square = an.Footprint.polygon([(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)])
    for value in (an.Footprint.disc(0.2), square, POST):
        twin = pickle.loads(pickle.dumps(value))
        assert twin == value == copy.deepcopy(value)
        assert hash(twin) == hash(value)
    assert an.Footprint.disc(0.2) != an.Footprint.disc(0.3) != square


def test_what_drives_can_be_sent_to_a_process() -> None:
    runner = an.EnsembleRunner(ROOM, SCANNER, "ekf")
    twin = pickle.loads(pickle.dumps(runner))
    ends = [made.drive(ROUTE, np.random.default_rng(1), 2).error for made in (runner, twin)]
    assert np.array_equal(*ends)
    spec = LOCALIZERS.get("mcl")
    assert pickle.loads(pickle.dumps(spec)) is spec


def test_with_layers_reports_as_build_map_does(capsys: pytest.CaptureFixture[str]) -> None:
    shares: list[float] = []
    assert "gfm" in an.with_layers(AMAP, "gfm", progress=shares.append).layers
    assert shares == [1.0]
    an.with_layers(AMAP, "gfm", progress=True)
    assert not capsys.readouterr().out


def test_drives_are_measured_by_what_is_public() -> None:
    figures = an.metrics(drive("ekf"), AMAP)  # type: ignore[arg-type]
    assert len(figures) == 2
    assert np.isfinite(figures.exposure).all()


def test_results_are_shown_in_a_line() -> None:
    drives = an.ensemble(ROOM, SCANNER, ROUTE, "ekf", np.random.default_rng(1), 2)
    assert repr(drives) == f"<Ensemble over 2.0 m: {drives.sentence}>"


def test_a_map_that_is_in_no_file_is_named_by_its_building() -> None:
    assert AMAP.source == "room"
    assert "RoutePlanner(room" in repr(planners.RoutePlanner(SERVICE))
