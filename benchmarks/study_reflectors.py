"""Layouts of reflectors by `ambinav design reflectors` against simpler rivals and optima.

A laser of 25 m all around with a beam each 0.25 degrees, reflecting posts of 5 cm radius, maps of
0.3 m, at least three reflectors in view. Criterion, written before the first run: in each building
the tool's layout serves at least as much floor as the best of 1000 random draws of the same
candidates, and at least 95 % of what the best subset does where all subsets are tried. *Spread*
are the candidates that are farthest apart. *Bound*: no choice of these candidates serves more by
the number in view (mixed-integer program, HiGHS; after a minute its bound so far).
"""

from __future__ import annotations

import itertools
import math
import time

import numpy as np
from harness import arguments, environment_path, recorded_maps, report, table
from numpy.typing import NDArray
from scipy.optimize import Bounds, LinearConstraint, milp
from scipy.sparse import csr_array, hstack, identity

from ambinav.buildings.load import load_environment
from ambinav.geometry.collision.reach import find_reach
from ambinav.geometry.environment import Environment
from ambinav.layers.context import LayerContext
from ambinav.layers.reflectors.positioning import Site
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules
from ambinav.map_building.build import build_map
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor
from ambinav.studies.design.place.candidates import PlaceRules
from ambinav.studies.design.place.positions import Positions
from ambinav.studies.design.reflectors.search import Search

RADIUS = 0.3
SPACING = 0.3
COUNTS = (6, 12)
PLACES = 150
DRAWS = 1000
SMALL, OF = 4, 12
SECONDS = 60.0
RULES = ReflectorRules()
POSTS = PlaceRules(radius=0.05, reflective=True, most=PLACES)
LASER = RangeSensor(
    min_range=0.5, max_range=25.0, std=0.01, resolution=0.001,
    intensity=Intensity(wall=0.3, reflector=1.0, std=0.15),
)  # fmt: skip
SCANNER = RangeScanner.planar(LASER, 1440, 2.0 * math.pi)
MAPS = ("nav2_depot", "willow_full_010", "belgioioso", "intel", "stata_basement", "f1_berlin")


def main() -> None:
    """Run every building, then report."""
    args = arguments(__doc__, maps=("all",), seed=1)
    rows, small = [], []
    for path in (environment_path("demo"), *recorded_maps()):
        names = args.maps if "all" not in args.maps else ("demo", *MAPS)
        if path.stem not in names:
            continue
        rng = np.random.default_rng(args.seed)
        environment = load_environment(path)
        begin = time.process_time()
        search = search_of(environment)
        seconds = time.process_time() - begin
        for count in COUNTS:
            begin = time.process_time()
            ours = served(search, search.place(count))
            took = seconds + time.process_time() - begin
            drawn = [served_by_number(search, draw(search, count, rng)) for _ in range(DRAWS)]
            spread = served(search, spread_out(search, count))
            bound = bound_of(search, count)
            floor = search.counted.sum() * search.site.lattice.cell_area
            values = (floor, ours, spread, max(drawn), float(np.mean(drawn)), bound, took)
            rows.append((path.stem, str(count), *(f"{value:.1f}" for value in values)))
            print(*rows[-1], flush=True)
        part = search_of(environment, neighbours(search, rng))
        ours = served(part, part.place(SMALL))
        best = max(
            served(part, subset)
            for subset in itertools.combinations(range(OF), SMALL)
            if not part.crowded[np.ix_(subset, subset)][np.triu_indices(SMALL, 1)].any()
        )
        small.append((path.stem, f"{ours:.1f}", f"{best:.1f}"))
        print(*small[-1], flush=True)
    head = (
        "building", "reflectors", "floor (m²)", "tool serves", "spread", "best of 1000 draws",
        "mean of draws", "bound", "tool, processor s",
    )  # fmt: skip
    about = (__doc__ or "").partition("\n\n")[2].strip()
    body = "\n\n".join(
        (
            about,
            table(head, rows),
            f"All subsets of {SMALL} of the {OF} candidates nearest to one drawn at random:",
            table(("building", "tool serves (m²)", "best subset"), small),
        )
    )
    report("Reflectors: against simpler rivals", ["numpy", "numba", "scipy"], body, args.out)


def search_of(environment: Environment, few: list[int] | None = None) -> Search:
    """Return the search in a building, among some of its candidates."""
    amap = build_map(environment, SCANNER, spacing=SPACING, store=False)
    reach = find_reach(environment, RADIUS)
    site = Site.of(LayerContext.of(amap, environment, SCANNER), RULES)
    counted = amap.for_robot(reach).judged.counted[site.lattice.free]
    points = np.column_stack(site.lattice.points)[counted]
    positions = Positions(environment, POSTS, points, SCANNER.max_range, reach.floor)
    candidates, _ = positions.spread_evenly(PLACES)
    if few is not None:
        candidates = tuple(candidates[i] for i in few)
    return Search(site, counted, Targets.of_outlines([]), candidates, POSTS.min_passage)


def neighbours(search: Search, rng: np.random.Generator) -> list[int]:
    """Return the candidates nearest to one that is drawn."""
    at = np.array([candidate.middle for candidate in search.candidates])
    away = np.hypot(*(at - at[rng.integers(len(at))]).T)
    return [int(i) for i in np.argsort(away)[:OF]]


def served(search: Search, chosen: tuple[int, ...]) -> float:
    """Return the floor on which a robot navigates by these candidates, square metres."""
    good = search.state(chosen).positioning.good[search.counted]
    return float(good.sum() * search.site.lattice.cell_area)


def served_by_number(search: Search, chosen: tuple[int, ...]) -> float:
    """Return the floor that sees enough of them: no less than `served`."""
    is_served = search.views[list(chosen), :, 0].sum(axis=0) >= RULES.needed
    return float(is_served[search.counted].sum() * search.site.lattice.cell_area)


def draw(search: Search, count: int, rng: np.random.Generator) -> tuple[int, ...]:
    """Draw candidates that are apart."""
    chosen: tuple[int, ...] = ()
    for i in rng.permutation(len(search.candidates)).tolist():
        if len(chosen) < count and not search.crowded[i, list(chosen)].any():
            chosen = *chosen, i
    return chosen


def spread_out(search: Search, count: int) -> tuple[int, ...]:
    """Return candidates that are farthest apart, the first the one nearest to the middle."""
    at = np.array([candidate.middle for candidate in search.candidates])
    chosen = [int(np.argmin(np.hypot(*(at - at.mean(axis=0)).T)))]
    while len(chosen) < count:
        away = np.linalg.norm(at[:, None] - at[chosen][None], axis=2).min(axis=1)
        chosen.append(int(np.argmax(away)))
    return tuple(chosen)


def bound_of(search: Search, count: int) -> float:
    """Return a bound of the floor that sees enough of any such choice, square metres."""
    views: NDArray[np.bool_] = search.views[:, search.counted, 0].T
    patterns, weight = np.unique(views, axis=0, return_counts=True)
    able = patterns.sum(axis=1) >= RULES.needed
    patterns, weight = patterns[able], weight[able]
    places, candidates = patterns.shape
    # Served places (z), then candidates (x): needed z <= what is in view of x, sum x <= count.
    rows = hstack([RULES.needed * identity(places), csr_array(-patterns.astype(float))])
    total = csr_array(np.concatenate([np.zeros(places), np.ones(candidates)])[None])
    result = milp(
        np.concatenate([-weight.astype(float), np.zeros(candidates)]),
        integrality=np.ones(places + candidates),
        bounds=Bounds(0.0, 1.0),
        constraints=[
            LinearConstraint(csr_array(rows), -np.inf, 0.0),
            LinearConstraint(total, -np.inf, float(count)),
        ],
        options={"time_limit": SECONDS},
    )
    return float(-result.mip_dual_bound * search.site.lattice.cell_area)


if __name__ == "__main__":
    main()
