"""What does it cost to leave less than 5 % and 2 % of a floor bad, and is the advice any good?

Maps of 0.2 m. Allowed are six posts (40 each), three panels (60 each), and another scanner: the
rplidar-a1 for 400 or the sick-tim571 for 1800. The costs are invented. Criterion, written before
the first run: with a budget for five posts and no other scanner, the advice leaves less bad floor
than each of 200 random placements of as many posts at the same candidate places, under the same
rules; every advice that meets its requirement does so by a map built anew without the store.
"""

from __future__ import annotations

import time
from functools import partial
from typing import Any

import numpy as np
from harness import arguments, environment_of, option, report, table

from ambinav.geometry.collision.reach import Reach, find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.sensing.robot_radius import robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Candidate, PlaceRules, apart
from ambinav.studies.design.requirement.costs import Allowed, Costs
from ambinav.studies.design.requirement.document import money, state_label
from ambinav.studies.design.requirement.requirement import Requirement
from ambinav.studies.design.requirement.states import CountedFloor, ObstacleSearch
from ambinav.studies.design.requirement.study import Solution, meet_requirement

BUILDINGS = (
    "demo", "nav2_depot", "aws_small_house", "belgioioso", "mrpt_uwb_hall", "navrep_markclutter",
)  # fmt: skip
SCANNERS = ("turtlebot3-lds", "hokuyo-urg-04lx")
WITH_HEADINGS = ("aws_small_house", "belgioioso", "mrpt_uwb_hall", "navrep_markclutter")
"""Buildings for scanners that do not look all around: their maps of 8 headings take longest."""
MAY = "posts=6,panels=3,scanner"
COSTS = Costs(post=40, panel=60, scanner={"rplidar-a1": 400, "sick-tim571": 1800})
POSTS = 5
SPACING = 0.2
PLACES = 60
"""Candidate places of a kind."""


def main() -> None:
    """Run every case, then report."""
    args = arguments(
        __doc__,
        environments=option(BUILDINGS),
        scanners=SCANNERS,
        limits=(5.0, 2.0),
        random=200,
        seed=1,
    )
    rows, random_rows = [], []
    for name in args.environments:
        environment = environment_of(name)
        for scanner in map(RangeScanner.from_preset, args.scanners):
            if not scanner.looks_all_around and name not in WITH_HEADINGS:
                continue
            reach = find_reach(environment, robot_radius(scanner))
            for limit in args.limits:
                required = Requirement.parse(f"bad < {limit:g} %")
                rows.append((name, scanner.name, *solved(environment, scanner, reach, required)))
        scanner = RangeScanner.from_preset(args.scanners[0])
        reach = find_reach(environment, robot_radius(scanner))
        if (
            drawn := against_random(environment, scanner, reach, args.random, args.seed)
        ) is not None:
            random_rows.append((name, *drawn))
    report(
        "Costs of requirements on bad floor", ["numpy", "numba"], body(rows, random_rows), args.out
    )


def solve(environment: Environment, scanner: RangeScanner, may: str, **how: Any) -> Solution:
    """Return the advice for maps without the store."""
    return meet_requirement(
        environment,
        scanner,
        partial(build_map, spacing=SPACING, store=False),
        Allowed.parse(may),
        COSTS,
        rules_of,
        **how,
    )


def rules_of(kind: Any, scanner: RangeScanner) -> PlaceRules:
    """Return the rules for obstacles of a kind."""
    return PlaceRules(kind=kind, most=PLACES, reflective=len(scanner.intensity_beams) > 0)


def solved(
    environment: Environment, scanner: RangeScanner, reach: Reach, required: Requirement
) -> tuple[str, ...]:
    """Return the cells of a requirement: what it takes, costs, leaves and how long that took."""
    begin = time.perf_counter()
    solution = solve(environment, scanner, MAY, reach=reach, requirement=required)
    seconds = time.perf_counter() - begin
    before, after = solution.before.state, solution.after.state
    return (
        str(required),
        state_label(after),
        "yes" if solution.met else "no",
        money(solution.cost),
        *(f"{100.0 * state.bad / state.areas.sum():.2f}" for state in (before, after)),
        str(solution.maps),
        str(len(solution.states)),
        f"{seconds:.1f}",
    )


def against_random(
    environment: Environment, scanner: RangeScanner, reach: Reach, count: int, seed: int
) -> tuple[str, ...] | None:
    """Return the cells of a comparison of advised and random posts; None where none is advised."""
    budget = POSTS * 40.0
    solution = solve(environment, scanner, f"posts={POSTS}", reach=reach, budget=budget)
    if not solution.steps:
        return None
    hardware, before = solution.before.state.hardware, solution.before
    search = ObstacleSearch(
        environment, hardware, before.amap, CountedFloor.of(before.amap), solution.terms
    )
    places = search.try_places(lambda text: lambda share: None)[0]["post"].candidates
    rng = np.random.default_rng(seed)
    posts = len(solution.after.state.obstacles)
    drawn = [search.state(random_posts(places, posts, rng)).bad for _ in range(count)]
    after = solution.after.state.bad
    beaten = sum(bad > after for bad in drawn)
    return (
        str(posts),
        str(len(places)),
        *(f"{value:.1f}" for value in (before.state.bad, after, min(drawn), np.median(drawn))),
        f"{beaten} of {count}",
    )


def random_posts(
    places: tuple[Candidate, ...], count: int, rng: np.random.Generator
) -> list[Candidate]:
    """Draw places that leave the passage between them."""
    chosen: list[Candidate] = []
    for i in rng.permutation(len(places)).tolist():
        if all(apart(places[i], other, PlaceRules().min_passage) for other in chosen):
            chosen.append(places[i])
        if len(chosen) == count:
            break
    return chosen


def body(rows: list[tuple[str, ...]], random_rows: list[tuple[str, ...]]) -> str:
    """Format both tables."""
    head = (
        "building", "scanner", "requirement", "changes", "met", "cost", "bad before (%)",
        "bad after (%)", "full maps", "sets", "seconds",
    )  # fmt: skip
    random_head = (
        "building", "posts", "places", "bad before (m²)", "advised (m²)", "best random (m²)",
        "median random (m²)", "random ones beaten",
    )  # fmt: skip
    posts = f"## {POSTS} posts with {SCANNERS[0]} against random placements"
    about = (__doc__ or "").partition("\n\n")[2].strip()
    tables = table(head, rows, words=5), posts, table(random_head, random_rows)
    return "\n\n".join((about, *tables))


if __name__ == "__main__":
    main()
