"""Exact solutions of small placements, to measure how far greedy is from the optimum.

Of a few candidates all pairs or triples are tried: that is the optimum of the true effect. For all
candidates there is a surrogate that a solver can prove: each candidate covers the bad floor that it
turns good alone, and the most floor is covered (maximum coverage, by CP-SAT of OR-Tools). It knows
nothing of floor that only two together turn good; what its choice truly does is measured.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from pydantic import Field

from ambinav.reports.fields import Part
from ambinav.runtime.progress import Progress, silent
from ambinav.studies.design.place.effect import Effects
from ambinav.studies.design.place.greedy import NOTHING, Trials, place
from ambinav.studies.design.place.placed_part import Rounded

SECONDS: Final = 20.0
"""The solver has so long to prove its optimum."""
SCALE: Final = 1_000_000
"""Floor is counted in millionths: the solver knows whole numbers."""


class OptimumPart(Part):
    """Optimum over all subsets of a few candidates, and greedy on the same candidates."""

    candidates: int
    count: int = Field(description="size of the subsets")
    subsets: int = Field(description="allowed ones, all of them tried")
    best: Rounded = Field(description="bad floor that the best subset takes away")
    greedy: Rounded = Field(description="bad floor that greedy's subset takes away")
    share: Rounded | None = Field(
        description="of the best one's objective that greedy reaches; null: it turns nothing good"
    )


class CoveragePart(Part):
    """Maximum coverage, counting the floor that each candidate improves alone."""

    covered: Rounded = Field(description="by the solver's choice")
    bound: Rounded = Field(description="no choice covers more")
    greedy: Rounded = Field(description="by greedy's choice")
    true: Rounded = Field(description="bad floor that the solver's choice truly takes away")


def enumerated(
    effects: Effects,
    trials: Trials,
    numbers: Sequence[int],
    count: int,
    passage: float,
    progress: Progress = silent,
) -> OptimumPart | None:
    """Try all subsets of some candidates; None if no subset is allowed.

    Args:
        effects: The building, in which they were tried.
        trials: The candidates, each alone.
        numbers: Indices of the candidates to use.
        count: Size of the subsets.
        passage: Metres to be left between two.
        progress: Called with the share done.
    """
    subsets = itertools.combinations(numbers, count)
    every = [subset for subset in subsets if trials.have_room(subset, passage)]
    if not every:
        return None
    gains: dict[tuple[int, ...], tuple[float, float]] = {}
    for k, subset in enumerate(every):
        if _independent(trials, subset):
            alone = [trials.gains[i] for i in subset]
            gain = math.fsum(each.cost for each in alone), math.fsum(each.bad for each in alone)
        else:
            together = trials.gain_together(effects, subset)
            gain = together.cost, together.bad
        gains[tuple(sorted(subset))] = gain
        progress((k + 1) / len(every))
    few = trials.among(numbers)
    taken = place(effects, few, count, passage)
    chosen = tuple(sorted(trials.candidates.index(placed.candidate) for placed in taken.placed))
    if chosen not in gains:  # one that would have made it worse is left out
        total = taken.before - taken.after
        gains[chosen] = total.cost, total.bad
    (best, best_bad), (greedy, greedy_bad) = max(gains.values()), gains[chosen]
    return OptimumPart(
        candidates=len(numbers),
        count=count,
        subsets=len(every),
        best=best_bad,
        greedy=greedy_bad,
        share=greedy / best if best_bad >= NOTHING else None,
    )


def covered_most(
    effects: Effects, trials: Trials, count: int, passage: float, greedy: Sequence[int]
) -> CoveragePart:
    """Solve maximum coverage by CP-SAT.

    Args:
        effects: The building, in which they were tried.
        trials: The candidates, each alone.
        count: Most candidates to choose.
        passage: Metres to be left between two.
        greedy: Choice of greedy; the solver starts from it.
    """
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    take = [model.new_bool_var(f"take {i}") for i in range(len(trials.candidates))]
    model.add(sum(take) <= count)
    for i, j in itertools.combinations(range(len(take)), 2):
        if not trials.have_room((i, j), passage):
            model.add_at_most_one(take[i], take[j])
    areas = _areas(effects, trials)
    terms = []
    for owners, area in areas.items():
        covered = model.new_bool_var(f"covered {owners}")
        model.add_bool_or([*(take[i] for i in owners), covered.negated()])
        terms.append(round(area * SCALE) * covered)
    model.maximize(sum(terms))
    for i, variable in enumerate(take):
        model.add_hint(variable, i in greedy)
    solver = cp_model.CpSolver()
    solver.parameters.max_time_in_seconds = SECONDS
    solver.parameters.random_seed = 1
    solver.parameters.num_workers = 1
    solver.solve(model)
    chosen = tuple(i for i, variable in enumerate(take) if solver.boolean_value(variable))
    return CoveragePart(
        covered=_covered(areas, chosen),
        bound=solver.best_objective_bound / SCALE,
        greedy=_covered(areas, greedy),
        true=trials.gain_together(effects, chosen).bad if chosen else 0.0,
    )


def _areas(effects: Effects, trials: Trials) -> dict[tuple[int, ...], float]:
    """Return the bad floor grouped by the candidates that improve it, each alone."""
    owners: dict[int, list[int]] = {}
    for i, fixed in enumerate(trials.fixed):
        for place_number in fixed.tolist():
            owners.setdefault(place_number, []).append(i)
    areas: dict[tuple[int, ...], float] = {}
    weights = effects.weights(np.array(list(owners), dtype=np.int64))
    for mine, weight in zip(map(tuple, owners.values()), weights.tolist(), strict=True):
        areas[mine] = areas.get(mine, 0.0) + weight
    return areas


def _covered(areas: dict[tuple[int, ...], float], chosen: Sequence[int]) -> float:
    taken = set(chosen)
    return math.fsum(area for owners, area in areas.items() if taken.intersection(owners))


def _independent(trials: Trials, subset: Sequence[int]) -> bool:
    """Return whether no two candidates change the same poses, so that their gains add up."""
    rows = np.concatenate([trials.rows[i] for i in subset])
    return len(np.unique(rows)) == len(rows)
