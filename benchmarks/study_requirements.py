"""What does it cost to leave less than 5 % and 2 % of a floor bad: by the advice, and by rivals?

Maps of 0.2 m of twenty buildings: the demo, every recorded map in which the robot reaches 100 to
900 m², and three drawn ones; five scanners, those that do not look all around in the buildings of
less than 400 m² only (maps of 8 headings take longest). Allowed are six posts (40 each), three
panels (60 each), and another scanner: the rplidar-a1 for 400 or the sick-tim571 for 1800. The costs
are invented. Rivals of the advice, at the same candidate places, under the same rules, and with the
same scanners to choose from; they need to meet the requirement on the counted floor only:

- greedy: with each scanner alone, the obstacle that removes most for its price, and so on, until
  the requirement holds; the cheapest of these;
- random: the cheapest of 1 000 draws of a scanner and obstacles in random order, each as long as
  the requirement needs (more obstacles are taken to leave no more bad floor).

Criterion, written before the first run: the advice costs no more than either rival in any case,
and every advice that meets its requirement does so by a map built anew without the store.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
from harness import arguments, option, report, table
from lost_case import building

from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.runtime.files import replacing
from ambinav.sensing.robot_radius import robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.candidates import Candidate, PlaceRules, apart
from ambinav.studies.design.place.greedy import Trials
from ambinav.studies.design.requirement.costs import Allowed, Costs
from ambinav.studies.design.requirement.document import money, state_label
from ambinav.studies.design.requirement.hardware import hardware_options
from ambinav.studies.design.requirement.requirement import Requirement
from ambinav.studies.design.requirement.states import CountedFloor, ObstacleSearch, Terms
from ambinav.studies.design.requirement.study import Solution, meet_requirement

BUILDINGS = (
    "demo", "aws_small_house", "f1_berlin", "mrpt_uwb_hall", "nav2_depot", "navrep_markclutter",
    "stata_basement", "stata_hallways_5cm", "aces", "belgioioso", "freiburg-079", "intel",
    "ipa_Freiburg79_scan", "ipa_Freiburg79_scan_furnitures", "ipa_lab_c_scan_furnitures",
    "ipa_lab_intel", "ipa_lab_intel_furnitures", "hall-1", "corridor-1", "warehouse-1",
)  # fmt: skip
SMALL = (
    "aws_small_house", "f1_berlin", "mrpt_uwb_hall", "nav2_depot", "navrep_markclutter",
    "freiburg-079", "intel", "ipa_Freiburg79_scan", "ipa_Freiburg79_scan_furnitures",
    "ipa_lab_c_scan_furnitures",
)  # fmt: skip
"""Buildings of less than 400 m²."""
SCANNERS = (
    "turtlebot3-lds", "polaroid-6500-ring", "ldrobot-ld19", "hokuyo-urg-04lx", "sick-lms200",
)  # fmt: skip
MAY = "posts=6,panels=3,scanner"
COSTS = Costs(post=40, panel=60, scanner={"rplidar-a1": 400, "sick-tim571": 1800})
SPACING = 0.2
PLACES = 60
"""Candidate places of a kind."""


def main() -> None:
    """Run every case that is not in the folder, then report."""
    args = arguments(
        __doc__,
        folder=option(None, "keep the cases here, and do not run those again", type=Path),
        buildings=option(BUILDINGS),
        scanners=SCANNERS,
        limits=(5.0, 2.0),
        random=1000,
        seed=1,
        report_only=option(False, "report the cases that are in the folder"),
    )
    cases = list(all_cases(args))
    report("Costs of requirements on bad floor", ["numpy", "numba"], body(cases), args.out)


def all_cases(args: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield each case, from the folder if it is there."""
    for scanner_name in args.scanners:
        for name in args.buildings:
            file = None if args.folder is None else args.folder / f"{name}_{scanner_name}.json"
            if file is not None and file.exists():
                yield from json.loads(file.read_text())
                continue
            if args.report_only:
                continue
            scanner = RangeScanner.from_preset(scanner_name)
            if not (scanner.looks_all_around or name in SMALL):
                continue
            cases = run(name, scanner, args)
            if file is not None:
                args.folder.mkdir(parents=True, exist_ok=True)
                with replacing(file) as temporary:
                    temporary.write_text(json.dumps(cases))
            yield from cases


def run(name: str, scanner: RangeScanner, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Return the cases of a building and a scanner, one for each limit."""
    environment = building(name)
    reach = find_reach(environment, robot_radius(scanner))
    cases, rivals = [], None
    for limit in args.limits:
        required = Requirement.parse(f"bad < {limit:g} %")
        begin = time.perf_counter()
        solution = solve(environment, scanner, MAY, reach=reach, requirement=required)
        seconds = time.perf_counter() - begin
        if rivals is None:
            rivals = Rivals(solution)
        rng = np.random.default_rng(args.seed)
        before, after = solution.before.state, solution.after.state
        cases.append(
            {
                "building": name,
                "scanner": scanner.name,
                "limit": limit,
                "changes": state_label(after),
                "bad_before": 100.0 * before.bad / before.areas.sum(),
                "bad_after": 100.0 * after.bad / after.areas.sum(),
                "advice": solution.cost if solution.met else None,
                "greedy": rivals.greedy(required),
                "random": rivals.drawn(required, args.random, rng),
                "sets": len(solution.states),
                "maps": solution.maps,
                "seconds": seconds,
            }
        )
        print(cases[-1], flush=True)
    return cases


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


class Rivals:
    """Other ways to meet a requirement with what a solution was allowed."""

    def __init__(self, solution: Solution) -> None:
        environment, scanner = solution.environment, solution.scanner
        self.terms = solution.terms
        self.passage = PlaceRules().min_passage
        options, _ = hardware_options(scanner, solution.allowed, COSTS, "costs")
        floor = CountedFloor.of(solution.before.amap)
        self.searches = []
        for hardware in options:
            amap = solution.before.whole
            if hardware.cost:
                amap = build_map(environment, hardware.scanner, spacing=SPACING, store=False)
            floor_of = floor.with_map(amap)
            search = ObstacleSearch(environment, hardware, amap, floor_of, self.terms)
            self.searches.append(search)
        self._trials: dict[int, Trials | None] = {}

    def trials(self, number: int) -> Trials | None:
        """Return each place alone with a scanner; None: there are none."""
        if number not in self._trials:
            kinds = list(
                self.searches[number].try_places(lambda text: lambda share: None)[0].values()
            )
            joined = None if not kinds else kinds[0]
            for kind in kinds[1:]:
                assert joined is not None
                joined = joined.and_of(kind)
            self._trials[number] = joined
        return self._trials[number]

    def greedy(self, required: Requirement) -> float | None:
        """Return the cost of the greedy rival; None: it does not meet the requirement."""
        cheapest = math.inf
        for number, search in enumerate(self.searches):
            state = search.state(())
            rows = self._greedy_rows(number)
            while not required.holds(state) and state.cost < cheapest:
                if (row := next(rows, None)) is None:
                    break
                state = search.state(row)
            if required.holds(state):
                cheapest = min(cheapest, state.cost)
        return None if math.isinf(cheapest) else cheapest

    def drawn(self, required: Requirement, count: int, rng: np.random.Generator) -> float | None:
        """Return the cost of the cheapest of so many draws; None: none meets the requirement."""
        cheapest = math.inf
        for _ in range(count):
            number = int(rng.integers(len(self.searches)))
            search = self.searches[number]
            trials = self.trials(number) if search.hardware.cost < cheapest else None
            places = () if trials is None else trials.candidates
            order = random_obstacles(places, self.terms, self.passage, rng)
            # The longest row of obstacles that still is cheaper, and then shorter ones.
            prices = [self.terms.prices[each.kind] for each in order]
            costs = list(accumulate(prices, initial=search.hardware.cost))
            length = sum(cost < cheapest for cost in costs) - 1
            while length >= 0 and required.holds(state := search.state(order[:length])):
                cheapest = state.cost
                length -= 1
        return None if math.isinf(cheapest) else cheapest

    def _greedy_rows(self, number: int) -> Iterator[tuple[Candidate, ...]]:
        """Yield 1, 2, ... obstacles, the next one that which removes most for its price."""
        search, trials = self.searches[number], self.trials(number)
        if trials is None:
            return
        prices = self.terms.prices
        value = {
            each: gain.cost / prices[each.kind]
            for each, gain in zip(trials.candidates, trials.gains, strict=True)
        }
        effects, chosen, fresh = search.effects.copy(), tuple[Candidate, ...](), set(value)
        while True:
            free = [
                each
                for each in value
                if self.terms.allows((*chosen, each))
                and all(apart(each, placed, self.passage) for placed in chosen)
            ]
            if not free or value[best := max(free, key=value.__getitem__)] <= 0.0:
                return
            if best not in fresh:
                value[best] = effects.tried([best.obstacle]).gain.cost / prices[best.kind]
                fresh.add(best)
                continue
            effects.put(effects.tried([best.obstacle]))
            chosen, fresh = (*chosen, best), set()
            yield chosen


def random_obstacles(
    places: Sequence[Candidate], terms: Terms, passage: float, rng: np.random.Generator
) -> list[Candidate]:
    """Draw as many obstacles as are allowed, passages between them kept."""
    chosen: list[Candidate] = []
    for i in rng.permutation(len(places)).tolist():
        if len(chosen) == sum(terms.most.values()):
            break
        if terms.allows((*chosen, places[i])) and all(
            apart(places[i], placed, passage) for placed in chosen
        ):
            chosen.append(places[i])
    return chosen


def body(cases: Sequence[Mapping[str, Any]]) -> str:
    """Format the tables."""
    head = (
        "building", "scanner", "bad <", "bad before (%)", "bad after (%)", "changes", "advice",
        "greedy", "cheapest of random", "sets", "full maps", "seconds",
    )  # fmt: skip
    rows = [
        (
            case["building"],
            case["scanner"],
            f"{case['limit']:g} %",
            f"{case['bad_before']:.2f}",
            f"{case['bad_after']:.2f}",
            case["changes"],
            *(cost(case[who]) for who in ("advice", "greedy", "random")),
            case["sets"],
            case["maps"],
            f"{case['seconds']:.1f}",
        )
        for case in cases
    ]
    about = (__doc__ or "").partition("\n\n")[2].strip()
    return "\n\n".join((about, summary(cases), "## All cases", table(head, rows, words=2)))


def summary(cases: Sequence[Mapping[str, Any]]) -> str:
    """Format what each way costs, by scanner and limit, where anything is to do."""
    head = (
        "scanner", "bad <", "cases", "met as it is", "met", "greedy: not met", "dearer",
        "by (%)", "random: not met", "dearer", "by (%)", "rival cheaper", "seconds (median, most)",
    )  # fmt: skip
    rows = []
    for scanner, limit in dict.fromkeys((case["scanner"], case["limit"]) for case in cases):
        every = [case for case in cases if (case["scanner"], case["limit"]) == (scanner, limit)]
        work = [case for case in every if case["advice"] != 0.0]
        seconds = [case["seconds"] for case in every]
        cells = [cell for rival in ("greedy", "random") for cell in against(work, rival)]
        rows.append(
            (
                scanner, f"{limit:g} %", len(every), len(every) - len(work),
                sum(case["advice"] is not None for case in work), *cells,
                sum(is_cheaper(case, "greedy") or is_cheaper(case, "random") for case in work),
                f"{np.median(seconds):.1f}, {max(seconds):.1f}",
            )
        )  # fmt: skip
    return table(head, rows)


def against(cases: Sequence[Mapping[str, Any]], rival: str) -> tuple[str, str, str]:
    """Return where the advice is met: how often a rival is not, costs more, and how much more."""
    pairs = [(case["advice"], case[rival]) for case in cases if case["advice"] is not None]
    solved = [(ours, theirs) for ours, theirs in pairs if theirs is not None]
    dearer = [100.0 * (theirs / ours - 1.0) for ours, theirs in solved if theirs > ours]
    return (
        str(len(pairs) - len(solved)),
        str(len(dearer)),
        "" if not dearer else f"{np.median(dearer):.0f}",
    )


def is_cheaper(case: Mapping[str, Any], rival: str) -> bool:
    """Return whether a rival meets the requirement for less, or where the advice does not."""
    return case[rival] is not None and (
        case["advice"] is None or case[rival] < case["advice"] - 1e-9
    )


def cost(value: float | None) -> str:
    """Format a cost; none: the requirement is not met."""
    return "not met" if value is None else money(value)


if __name__ == "__main__":
    main()
