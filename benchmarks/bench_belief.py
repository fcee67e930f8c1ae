"""Covariances predicted by the belief planners along a route, compared with drives of it.

Routes are the shortest ones between places drawn at random. Each is driven open loop, with the same
seeds for every localizer: the truth stays on the route, so that all errors are of the pose that the
prediction is of. The localizers know the true model of odometry: the particle filters, which take
in a scan every 0.25 m or 0.2 rad, its variances after that, the Kalman filter, which takes in every
scan (5 a second), those between two scans. What is held against them are
the planners' own figures: of `belief-roadmap` the covariance of the pose at each node of the route,
cut into pieces of `PIECE` metres; of `belief` the isotropic deviation there.

- *NEES*: normalised estimation error squared e' P^-1 e of the position by its degrees of freedom,
  mean over nodes and runs, with its 95 % interval by the bootstrap over runs; 1 is expected, more
  says that the prediction is too small. A few runs that are lost decide it; hence the median over
  runs (0.8 to 0.9 is expected) as well.
- *95 %*: share of nodes and runs within the ellipse that is to hold 95 % of them.
- *with heading*: NEES of x, y and heading by 3.
- *goal*: deviation predicted at the goal by the root of the mean square of the error there; 1 is
  expected. Median and extremes over the routes.
"""

from __future__ import annotations

import argparse
import math
import sys
from typing import Any

import numba
import numpy as np
from harness import arguments, environment_of, report, spread, table
from numpy.typing import NDArray
from plan_case import pairs

from ambinav.drive.bootstrap import bootstrap
from ambinav.drive.drive import drive_route
from ambinav.drive.localizer_spec import chosen_localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.forecasting.information_field import InformationField
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.map_building.build import build_map
from ambinav.routes.route import Route
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService
from ambinav_planners import RoutePlanner
from ambinav_planners.belief.lattice_search import Growth, std_along
from ambinav_planners.belief.model import BeliefModel
from ambinav_planners.belief.roadmap import BeliefRoadmap
from ambinav_planners.search.graph import MotionGraph

LIBRARIES = ("ambinav", "numba", "numpy", "scipy", "ompl")
MAPS = ("demo", "willow_full_005", "stata_hallways_5cm", "nav2_depot")
SCANNER = "turtlebot3-lds"
SCALES = (0.25, 0.5)
LOCALIZERS = {
    "MCL, product": {
        "laser_model_type": "likelihood_field_prob", "importance_factor": 0.3, "sigma_hit": 0.1
    },
    "MCL, AMCL's field": {},
    "Kalman filter": {"type": "ekf"},
}  # fmt: skip
START_STD = (0.05, 0.05, 0.02)
ROBOT = Robot(radius=0.105)
MARGIN = 0.195
PIECE = 0.5
RATE = 5.0
ELLIPSE = 5.991
"""95 % of the square of a normal deviation in the plane."""
HEADER = (
    "map", "odometry", "localizer", "NEES", "median", "95 %", "with heading", "goal",
    "`belief`: NEES", "median", "95 %",
)  # fmt: skip

Floats = NDArray[np.float64]


def main() -> None:
    """Drive, predict and print the table."""
    args = arguments(__doc__, maps=MAPS, routes=4, runs=30, seed=7)
    numba.set_num_threads(1)
    rows = []
    for name in args.maps:
        print(f"driving in {name}", file=sys.stderr)
        rows += rows_of(name, args)
    body = (
        f"{str(__doc__).split(chr(10) * 2, 1)[1].strip()}\n\nScanner {SCANNER}, {args.routes} "
        f"routes a map, {args.runs} runs a route and localizer; *odometry* is the scale of "
        "`OdometryNoise`, whose predictions are those of the planners' defaults but for the "
        f"odometry and the start.\n\n{table(HEADER, rows, 3)}"
    )
    report("Predicted covariances and drives", LIBRARIES, body, args.out)


def rows_of(name: str, args: argparse.Namespace) -> list[tuple[str, ...]]:
    """Return the rows of one map."""
    environment = environment_of(name)
    scanner = RangeScanner.from_preset(SCANNER)
    amap = build_map(environment, scanner, store=False)
    planner = RoutePlanner(AmbiguityService(amap, weight=0.0), footprint=ROBOT.radius + MARGIN)
    routes = [
        planner.plan(start, goal, planner_name="reference")
        for start, goal in pairs(planner, args.routes, args.seed)
    ]
    information = InformationField.of(amap)
    rows = []
    for scale in SCALES:
        noise = OdometryNoise(scale=scale)
        predictions = [predicted(information, cut(route), noise) for route in routes]
        for title, parameters in LOCALIZERS.items():
            errors = [
                errors_at(environment, scanner, route, noise, parameters, (args, number))
                for number, route in enumerate(routes)
            ]
            rows.append((name, f"{scale:g}", title, *figures(predictions, errors, args.seed)))
    return rows


def cut(route: Route) -> Floats:
    """Return nodes along a route, at most `PIECE` metres apart, corners included, shape (N, 3)."""
    parts = [route.poses[:1, :2]]
    for a, b in zip(route.poses[:-1, :2], route.poses[1:, :2], strict=True):
        count = math.ceil(float(np.hypot(*(b - a))) / PIECE - 1e-9)
        parts.append(a + np.linspace(0.0, 1.0, count + 1)[1:, np.newaxis] * (b - a))
    xy = np.vstack(parts)
    return Steering().oriented(np.column_stack([xy, np.zeros(len(xy))]))


def predicted(
    information: InformationField, nodes: Floats, noise: OdometryNoise
) -> tuple[Floats, Floats]:
    """Return covariances, (N, 3, 3), and isotropic deviations, (N,), at the nodes."""
    count, length = len(nodes) - 1, np.hypot(*np.diff(nodes[:, :2], axis=0).T)
    first = np.minimum(np.arange(count + 2), count)
    target = np.arange(1, count + 1, dtype=np.int32)
    graph = MotionGraph(nodes, first, target, length, length, np.zeros(count), Steering())
    model, motions = BeliefModel(start_std=START_STD), np.arange(count)
    roadmap = BeliefRoadmap.of(graph, information, noise, scan_distance=model.scan_distance)
    covariances = roadmap.along(motions, np.diag(np.square(START_STD)))
    return covariances, std_along(Growth.of(graph, information, model, noise), motions, model.std)


def errors_at(
    environment: Environment,
    scanner: RangeScanner,
    route: Route,
    noise: OdometryNoise,
    parameters: dict[str, Any],
    case: tuple[argparse.Namespace, int],
) -> Floats:
    """Return the estimates' errors where drives pass the nodes of a route, shape (R, N, 3)."""
    args, number = case
    localizer = chosen_localizer(parameters, noise, ROBOT, RATE)
    drives = drive_route(
        environment, scanner, ROBOT, route, localizer, np.random.default_rng([args.seed, number]),
        args.runs, noise=noise, open_loop=True, rate=RATE, start_std=START_STD,
    )  # fmt: skip
    nodes, truth = cut(route), drives.truth[0]
    at = [0]
    for node in nodes[1:]:
        # The next sample from here on that is nearer than those beside it.
        away = np.hypot(*(truth[at[-1] :, :2] - node[:2]).T)
        at.append(at[-1] + int(np.argmax(away <= PIECE / 4.0)))
        while at[-1] + 1 < len(truth) and (
            np.hypot(*(truth[at[-1] + 1, :2] - node[:2]))
            < np.hypot(*(truth[at[-1], :2] - node[:2]))
        ):
            at[-1] += 1
    return drives.errors()[:, at]


def figures(
    predictions: list[tuple[Floats, Floats]], errors: list[Floats], seed: int
) -> tuple[str, ...]:
    """Return the measured cells of a row, without the start, whose covariance is given."""
    rng = np.random.default_rng(seed)
    plane, isotropic, full, ratio = [], [], [], []
    for (covariances, std), off in zip(predictions, errors, strict=True):
        place = off[:, 1:, :2]
        plane.append(squares(place, covariances[1:, :2, :2]))
        isotropic.append((place**2).sum(axis=-1) / std[1:] ** 2)
        full.append(squares(off[:, 1:], covariances[1:]))
        expected = math.sqrt(np.trace(covariances[-1, :2, :2]))
        ratio.append(expected / math.sqrt((off[:, -1, :2] ** 2).sum(axis=-1).mean()))
    nees = f"{bootstrap(per_run(full) / 3.0, rng)}"
    return *of_plane(plane, rng), nees, spread(ratio), *of_plane(isotropic, rng)


def squares(errors: Floats, covariances: Floats) -> Floats:
    """Return e' P^-1 e of errors (R, N, D) for covariances (N, D, D), shape (R, N)."""
    return np.asarray(np.einsum("rni,nij,rnj->rn", errors, np.linalg.inv(covariances), errors))


def of_plane(parts: list[Floats], rng: np.random.Generator) -> tuple[str, str, str]:
    """Return the NEES with its interval, its median over runs, and the share within the ellipse."""
    nees = per_run(parts) / 2.0
    within = per_run([part <= ELLIPSE for part in parts])
    return f"{bootstrap(nees, rng)}", f"{np.median(nees):.2f}", f"{100.0 * within.mean():.0f} %"


def per_run(parts: list[Any]) -> Floats:
    """Return the mean over the nodes for each run of each route."""
    return np.concatenate([part.mean(axis=1) for part in parts])


if __name__ == "__main__":
    main()
