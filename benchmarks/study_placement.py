"""Do five posts by `ambinav design place` stand near the best places, and what if the map is old?

Recorded maps and the demo building, maps of 0.2 m, the TurtleBot3's LDS (3.5 m, all around), five
posts of 0.1 m radius, 0.9 m of passage, for all floor that the robot reaches. Criterion, written
before the first run: on all maps with 1 to 5000 m² of bad floor the default removes at least 97 %
of what the same search removes with ten times the candidates, in no more processor time than the
default took when it looked for the optimum of small cases (`--examine`) and moved no post.

*greedy* is the search as it was: 200 candidates spread evenly, no moves. *aged* are 20 buildings
whose walls are displaced by 3 cm and whose free-standing objects by 0.5 m (standard deviations).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from harness import arguments, environment_path, recorded_maps, report, table

from ambinav.buildings.load import load_environment
from ambinav.geometry.collision.reach import Reach, find_reach
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.sensing.robot_radius import robot_radius
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.place.aged import WORST
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.greedy import place, try_alone
from ambinav.studies.design.place.positions import Positions
from ambinav.studies.design.place.study import Remedy, place_obstacles

SCANNER = "turtlebot3-lds"
POSTS = 5
FORMER = 200
"""Candidates of the search as it was."""
SPACING = 0.2
MORE = 10
LEAST = 1.0
"""Maps with less bad floor are left out, square metres,"""
MOST = 5000.0
"""and those with more: their study takes hours; so does that of maps of games."""
GAMES = "movingai"


def main() -> None:
    """Run every map, then report."""
    args = arguments(__doc__, maps=("all",), aged=20, seed=1)
    rows, shares = [], []
    for path in (environment_path("demo"), *recorded_maps()):
        if ("all" not in args.maps and path.stem not in args.maps) or path.stem.startswith(GAMES):
            continue
        case = Case.of(path)
        if case is None:
            continue
        rng = np.random.default_rng(args.seed)
        default, seconds = case.placed(PlaceRules().most)
        larger, larger_seconds = case.placed(MORE * PlaceRules().most)
        aged, _ = case.placed(PlaceRules().most, rng=rng, aged=args.aged, examine=False)
        greedy, greedy_seconds = before_moves(default)
        _, examined = case.placed(PlaceRules().most, rng=rng)
        best = max(removed(default), removed(larger))
        shares.append(removed(default) / best)
        assert aged.aged is not None
        areas = (
            default.placement.before.bad, greedy, removed(default), removed(larger),
            greedy_seconds + examined - seconds, seconds, larger_seconds, aged.aged.before.mean(),
            aged.aged.gain.mean(), np.percentile(aged.aged.gain, WORST),
        )  # fmt: skip
        cells = [f"{value:.1f}" for value in areas]
        rows.append((path.stem, *cells[:4], f"{shares[-1]:.3f}", *cells[4:]))
        print(*rows[-1], flush=True)
    head = (
        "map", "bad (m²)", "greedy removes", "default removes", "ten times the work removes",
        "share of the best", "s as it was, with examination", "s, default", "s, ten times",
        "aged: bad", "removed, mean", "removed, 10th percentile",
    )  # fmt: skip
    about = (__doc__ or "").partition("\n\n")[2].strip()
    of_greedy, of_default, of_more = (sum(float(row[k]) for row in rows) for k in (2, 3, 4))
    summary = (
        f"Removed in all: {of_greedy:.0f} m² by greedy search, {of_default:.0f} m² by default, "
        f"{of_more:.0f} m² with ten times the work. Share of the best: least {min(shares):.3f}, "
        f"mean {np.mean(shares):.3f}; at least 0.97 on {sum(share >= 0.97 for share in shares)} "
        f"of {len(shares)} maps."
    )
    body = "\n\n".join((about, summary, table(head, rows)))
    report("Five posts: near the best places?", ["numpy", "numba", "shapely"], body, args.out)


@dataclass(frozen=True)
class Case:
    """A building with its map and the floor that the robot reaches."""

    environment: Environment
    scanner: RangeScanner
    amap: AmbiguityMap
    reach: Reach

    @classmethod
    def of(cls, path: Path) -> Case | None:
        """Return the case of a map; None without enough, or with too much, bad floor."""
        environment, scanner = load_environment(path), RangeScanner.from_preset(SCANNER)
        amap = build_map(environment, scanner, spacing=SPACING, store=False)
        reach = find_reach(environment, robot_radius(scanner))
        judged = amap.for_robot(reach)
        bad = np.isin(judged.floor("zone").values, (2, 3)) & judged.judged.counted
        if not LEAST <= bad.sum() * amap.cell_area <= MOST:
            return None
        return cls(environment, scanner, amap, reach)

    def placed(self, most: int, **how: Any) -> tuple[Remedy, float]:
        """Place the posts among so many candidates; return processor seconds too."""
        begin = time.process_time()
        remedy = place_obstacles(
            self.environment, self.scanner, self.amap, PlaceRules(most=most), POSTS, self.reach,
            **how,
        )  # fmt: skip
        return remedy, time.process_time() - begin


def removed(remedy: Remedy) -> float:
    """Return the bad floor that a placement removes, square metres."""
    return remedy.placement.before.bad - remedy.placement.after.bad


def before_moves(remedy: Remedy) -> tuple[float, float]:
    """Return what greedy search removes from evenly spread candidates, and processor seconds."""
    begin = time.process_time()
    setting, places = remedy.placement.effects.setting, remedy.placement.effects.places
    effects = type(remedy.placement.effects)(remedy.environment, setting, places)
    bad = np.column_stack(setting.lattice(remedy.environment)[0].points)[places.point[effects.bad]]
    sight = remedy.scanner.max_range
    allowed = Positions(remedy.environment, remedy.rules, bad, sight, remedy.reach.floor)
    trials = try_alone(effects, allowed.spread_evenly(FORMER)[0])
    placement = place(effects, trials, POSTS, remedy.rules.min_passage)
    return placement.before.bad - placement.after.bad, time.process_time() - begin


if __name__ == "__main__":
    main()
