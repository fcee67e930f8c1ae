"""Does the layer `reflectors` say where robots that navigate by reflectors alone lose themselves?

And does a layout by `ambinav design reflectors` lose fewer of them than random draws?

The criterion, written before the first run:

- Buildings: the demo, six recorded maps and three drawn ones. The laser of `study_reflectors.py`
  (25 m, a beam each 0.25 degrees), 12 posts of 5 cm radius, maps of 0.3 m. Four random draws of 12
  of the same candidates in each building, under the same rules; three routes sampled beside each,
  on floor that both layouts leave free.
- Drives: the localizer `reflectors` at 1 m/s, 8 scans a second, the true pose on the route, 30
  seeds; the same with the planned layout, with the random one, and without reflectors (dead
  reckoning). Odometry of 4.5 degrees and 6 cm in a metre (`--odometry mediocre`), which the
  localizer knows. World and map are the same.
- A robot is lost whose error is above 0.5 m or 30 degrees for over a second; it loses itself where
  the error first exceeds that.
- The layer is of use if robots lose themselves at least five times as often in a metre of floor
  that it does not call navigable (three in view, no aliasing, 5 cm) as in a metre of floor that it
  does, and if fewer than 1 % are lost on routes that are navigable throughout. The layout is of use
  if the interval of the difference of lost shares, planned less random, lies below 0.

Added after the first run (commit 52517058f93e), in which planned layouts lost 25.3 % of the robots,
random ones 29.0 % (-14.5 to 6.9 points), and two in view were nearly as good as three: layouts that
are planned for two in view (`--needed 2`), on routes that leave them free as well.

Intervals of 95 %. Those of shares are by building, in one building by route (`drive.shares`); for
the others buildings are drawn with replacement, then routes in each (`grouped_weights`).
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import numpy as np
from harness import appended, environment_path, kept_rows, option, parser_of, recorded_maps, report
from numpy.typing import NDArray
from reflector_drives_tables import IN_VIEW, LAYOUTS, SURE, body
from scipy.spatial import KDTree
from study_reflectors import POSTS, RADIUS, RULES, SCANNER, SPACING, draw, search_of

from ambinav.buildings.load import load_environment
from ambinav.drive.drive import drive_route
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION, first_lost
from ambinav.drive.odometries import ODOMETRIES
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.robot import Robot
from ambinav.geometry.collision.reach import reach_of
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.positioning import Site
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import seen_reflectors
from ambinav.map_building.build import build_map
from ambinav.routes.route import Route
from ambinav.routes.sampled import path_length, sample_routes
from ambinav.studies.design.reflectors.study import GOOD, STATES, plan_reflectors, states
from ambinav_envs.buildings.suites import suite

MAPS = ("nav2_depot", "willow_full_010", "belgioioso", "intel", "stata_basement", "f1_berlin")
DRAWN = ("hall-1", "office-1", "warehouse-1")
COUNT, DRAWS, ROUTES, RUNS = 12, 4, 3, 30
SHORTEST, LONGEST = 10.0, 70.0
"""Length of routes, metres."""
SPEED, RATE = 1.0, 8.0
ROBOT = Robot(radius=RADIUS, max_speed=SPEED)
FOLLOWER = FollowerParameters(desired_linear_vel=SPEED)
Row = dict[str, Any]
Floats = NDArray[np.float64]


def main() -> None:
    """Drive what is missing, then report."""
    parser = parser_of(
        __doc__,
        folder=Path("out/reflector-drives"),
        buildings=("demo", *MAPS, *DRAWN),
        odometry=option("mediocre", choices=tuple(ODOMETRIES)),
        seed=1,
        report_only=False,
    )
    args = parser.parse_args()
    numba.set_num_threads(1)
    path = args.folder / f"{args.odometry}.jsonl"
    for name in () if args.report_only else args.buildings:
        if name not in {row["building"] for row in kept_rows(path)}:
            rows = list(drives_in(name, args))
            with appended(path) as append:
                for row in rows:
                    append(row)
            print(name, len(rows), flush=True)
    title = "Reflectors: robots that navigate by them alone"
    report(title, ["numpy", "numba", "shapely"], body(__doc__ or "", kept_rows(path)), args.out)


def building(name: str) -> Environment:
    """Return a building by its name."""
    if name in DRAWN:
        family, _, number = name.rpartition("-")
        return suite(family).building(int(number))
    return load_environment(environment_path(name) if name == "demo" else recorded_maps([name])[0])


def drives_in(name: str, args: argparse.Namespace) -> Iterable[Row]:
    """Yield a row for each route and layout in a building."""
    environment, rng = building(name), np.random.default_rng(args.seed)
    amap = build_map(environment, SCANNER, spacing=SPACING, store=False)
    reach = reach_of(environment, RADIUS)
    planned = {}
    for arm, rules in (("planned", RULES), ("for two", replace(RULES, needed=2))):
        layout = plan_reflectors(environment, SCANNER, amap, reach, rules, POSTS, COUNT)
        planned[arm] = [candidate.obstacle for candidate in layout.chosen]
    search = search_of(environment)
    judged = {arm: Judged(environment.edited(add=posts)) for arm, posts in planned.items()}
    for k in range(DRAWS):
        posts = [search.candidates[i].obstacle for i in draw(search, COUNT, rng)]
        judged["random"] = Judged(environment.edited(add=posts))
        for number, route in enumerate(
            routes_beside(environment, sum(planned.values(), posts), rng)
        ):
            for arm in LAYOUTS:
                seeds = np.random.default_rng([args.seed, k, number])
                key = {"building": name, "route": ROUTES * k + number, "layout": arm}
                yield key | driven(environment, judged.get(arm), route, args.odometry, seeds)


def routes_beside(
    environment: Environment, posts: Sequence[Obstacle], rng: np.random.Generator
) -> list[Route]:
    """Return routes of fair length that touch none of the posts."""
    world = environment.edited(add=posts)
    routes = sample_routes(world, reach_of(world, RADIUS), 6 * ROUTES, rng)
    return [route for route in routes if SHORTEST <= path_length(route) <= LONGEST][:ROUTES]


class Judged:
    """A building with reflectors, and the state of its floor by the layer `reflectors`."""

    def __init__(self, environment: Environment) -> None:
        amap = build_map(environment, SCANNER, spacing=SPACING, store=False)
        context = LayerContext.of(amap, environment, SCANNER)
        site = Site.of(context, RULES)
        self.environment, self.targets = environment, Targets.of(environment)
        positioning = site.positioning(self.targets, site.views(self.targets))
        self._states = states(positioning, context.free)[context.free]
        self._points = KDTree(np.column_stack(site.lattice.points))

    def states(self, poses: Floats) -> NDArray[np.uint8]:
        """Return the state at the map's nearest point to each pose (N, 3), shape (N,)."""
        return np.asarray(self._states[self._points.query(poses[:, :2])[1]])

    def in_view(self, poses: Floats) -> NDArray[np.intp]:
        """Return how many reflectors are in view from each pose, up to 3, shape (N,)."""
        seen = seen_reflectors(self.environment, SCANNER, self.targets, poses, RULES)
        return np.minimum(seen.sum(axis=1), 3)


def driven(
    environment: Environment,
    judged: Judged | None,
    route: Route,
    odometry: str,
    rng: np.random.Generator,
) -> Row:
    """Drive a route; without a judged building by dead reckoning.

    Returns:
        Which runs were lost, and sure of themselves then; of the route's length the metres by state
        and by number in view that robots drove before they lost themselves, summed over the runs,
        and how many did there.
    """
    world = environment if judged is None else judged.environment
    drives = drive_route(
        world, SCANNER, ROBOT, route, "odometry" if judged is None else "reflectors", rng, RUNS,
        noise=ODOMETRIES[odometry], rate=RATE, follower=FOLLOWER, open_loop=True,
    )  # fmt: skip
    errors = drives.errors()
    far = np.hypot(errors[..., 0], errors[..., 1]) > LOST_POSITION
    far |= np.abs(errors[..., 2]) > LOST_HEADING
    lost_after = np.array([first_lost(drives.time, run) for run in far])
    # The first sample of the second after which a robot counts as lost.
    onset = np.full(RUNS, far.shape[1])
    for k in np.flatnonzero(np.isfinite(lost_after)):
        end = int(np.searchsorted(drives.time, lost_after[k]))
        onset[k] = end - int(np.argmin(far[k, : end + 1][::-1])) + 1
    lost = onset < far.shape[1]
    claimed = np.sqrt(np.linalg.eigvalsh(drives.covariance[..., :2, :2])[..., -1])
    ends = np.minimum(onset, far.shape[1] - 1)
    sure = lost & (claimed[np.arange(RUNS), ends] < SURE)
    row: Row = {"length": drives.length, "lost": lost.tolist(), "sure": sure.tolist()}
    inside = ~far[:, 1:].any(axis=1)
    row["rmse"] = np.sqrt((errors[inside, :, :2] ** 2).sum(axis=2).mean(axis=1)).tolist()
    if judged is None:
        return row
    poses = drives.truth[0]
    steps = np.hypot(*np.diff(poses[:, :2], axis=0, prepend=poses[:1, :2]).T)
    before = onset[:, None] > np.arange(len(poses))
    state, view = judged.states(poses), judged.in_view(poses)
    for name, kind, kinds in (("state", state, len(STATES)), ("view", view, len(IN_VIEW))):
        metres = np.bincount(kind, steps * before.sum(axis=0), kinds)
        row[f"{name}_metres"] = metres.tolist()
        row[f"{name}_onsets"] = np.bincount(kind[onset[lost]], minlength=kinds).tolist()
    row["stretch"] = longest(state != GOOD, steps)
    row["navigable"], row["unseen"] = (
        float(steps[mask].sum()) for mask in (state == GOOD, view == 0)
    )
    return row


def longest(mask: NDArray[np.bool_], steps: Floats) -> float:
    """Return the length of the longest stretch of samples in a mask, metres."""
    groups = itertools.groupby(zip(mask.tolist(), steps.tolist(), strict=True), lambda s: s[0])
    return max((sum(step for _, step in group) for inside, group in groups if inside), default=0.0)


if __name__ == "__main__":
    main()
