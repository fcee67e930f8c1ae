"""Search of the fewest beams within a stated loss, with a comparison of the search methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal

import numpy as np

from ambinav.reports.fields import Part
from ambinav.runtime.errors import InputError
from ambinav.runtime.progress import Progress, silent
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.beams.loss import Loss, Points
from ambinav.studies.design.beams.sample import MapSample
from ambinav.studies.design.beams.search import Kept, at_random, best_of_all, even, grow, objective

MOST_EXACT: Final = 12
"""Maximum number of beams for which all subsets are tried."""
DRAWS: Final = 10
"""Random subsets of each size."""
BEYOND: Final = 1.5
"""The curves of even and random subsets end at this multiple of the number of selected beams."""

ROUNDING: Final = 1e-9
"""Points; so much above the limit is within it."""

Method = Literal["even", "greedy", "exact", "all"]


@dataclass(frozen=True)
class Subset:
    """A subset of the beams and the loss of its maps: the worst over all maps.

    Attributes:
        beams: Indices into the scanner's, ascending.
        loss: Loss on the poses on which beams were chosen.
        checked: Loss on other poses of the same maps.
    """

    beams: Kept
    loss: Loss
    checked: Loss

    def within(self, limit: float) -> bool:
        """Return whether both losses are at most `limit` percentage points."""
        return max(self.loss.points, self.checked.points) <= limit + ROUNDING


class RandomPart(Part):
    """Random subsets of one size: loss on the poses for checking, points."""

    beams: int
    lowest_points: Points
    mean_points: Points
    highest_points: Points


class GapPart(Part):
    """The greedy subset of one size against the best of all subsets.

    By what the search makes small, points: `Loss.level` in the mean over the maps, on the poses
    that beams were chosen on.
    """

    beams: int
    subsets: int
    greedy_points: Points
    exact_points: Points


@dataclass(frozen=True, eq=False)
class Choice:
    """Result of the search.

    Attributes:
        scanner: The full scanner, with its true mounts.
        limit: The stated loss, points.
        chosen: The subset: the fewest beams that stay within the limit; of equals the even one.
        method: Search method of the subset; "all" where nothing can be left out.
        curves: Subsets of growing size, by method: "greedy" and "even".
        fewest: The fewest beams within the limit of either; None: not up to where it was followed.
        random: Random subsets of the same sizes.
        gaps: Greedy against the optimum, for small scanners.
        each: Loss of the chosen subset on the poses for checking, map by map, with its name.
    """

    scanner: RangeScanner
    limit: float
    chosen: Subset
    method: Method
    curves: dict[str, tuple[Subset, ...]]
    fewest: dict[str, int | None]
    random: tuple[RandomPart, ...]
    gaps: tuple[GapPart, ...]
    each: tuple[tuple[str, Loss], ...]


def choose(
    scanner: RangeScanner,
    samples: Sequence[MapSample],
    checks: Sequence[MapSample],
    limit: float,
    rng: np.random.Generator,
    progress: Progress = silent,
) -> Choice:
    """Find the fewest beams that stay within a loss on every map.

    Args:
        scanner: The full scanner.
        samples: Poses of each map to choose on; of `scanner`, or of it centred.
        checks: Other poses of the same maps.
        limit: Points, above 0.
        rng: Draws candidates and random subsets.
        progress: Called with the share done, from 0 to 1, as far as that is known.

    Raises:
        InputError: the limit is out of its range, or the scanner has a single beam.
    """
    check_limit(limit)
    check_beams(scanner)

    def measured(beams: Kept) -> Subset:
        indices = tuple(sorted(beams))
        return Subset(indices, _loss(samples, indices), _loss(checks, indices))

    by_method: dict[str, list[Subset]] = {"even": [], "greedy": []}
    fewest: dict[str, int | None] = dict.fromkeys(by_method)
    greedy = grow(samples, rng)
    for count in range(1, scanner.beams + 1):
        for name in by_method:
            # Once the even beams are within the limit, larger greedy subsets are no improvement.
            if name == "greedy" and (fewest["greedy"] or (fewest["even"] or count) < count):
                continue
            subset = measured(next(greedy) if name == "greedy" else even(scanner, count))
            by_method[name].append(subset)
            if fewest[name] is None and subset.within(limit):
                fewest[name] = count
        progress(min(count / scanner.beams, 1.0))
        if fewest["even"] is not None and count >= BEYOND * min(filter(None, fewest.values())):
            break
    chosen, method = _fewest(by_method, fewest)
    gaps: tuple[GapPart, ...] = ()
    if scanner.beams <= MOST_EXACT:
        gaps = _exact_gaps(samples, by_method["greedy"])
        smaller = _exact(scanner.beams, len(chosen.beams), samples, limit, measured)
        if smaller is not None:
            chosen, method = smaller, "exact"
    if len(chosen.beams) == scanner.beams:
        method = "all"
    draws = tuple(
        _random_part(
            [_loss(checks, at_random(scanner, count, rng)).points for _ in range(DRAWS)], count
        )
        for count in _sizes(len(by_method["even"]))
    )
    progress(1.0)
    return Choice(
        scanner,
        limit,
        chosen,
        method,
        {name: tuple(subsets) for name, subsets in by_method.items()},
        fewest,
        draws,
        gaps,
        tuple((sample.name, sample.loss(chosen.beams)) for sample in checks),
    )


def check_limit(limit: float, option: str = "loss") -> None:
    """Check that a stated loss is valid.

    Raises:
        InputError: it is not above 0 and below 100 points.
    """
    if not 0.0 < limit < 100.0:
        raise InputError(
            f"{option}: {limit:g} is not a valid loss; give percentage points above 0 and below "
            "100, e.g. 5."
        )


def check_beams(scanner: RangeScanner) -> None:
    """Check that the scanner has beams that can be left out.

    Raises:
        InputError: the scanner has a single beam.
    """
    if scanner.beams < 2:
        raise InputError(
            f"scanner {scanner.name!r} has a single beam, which cannot be left out; give one with "
            "2 beams or more."
        )


def _loss(samples: Sequence[MapSample], beams: Kept) -> Loss:
    return Loss.worst(sample.loss(beams) for sample in samples)


def _fewest(
    subsets: dict[str, list[Subset]], fewest: dict[str, int | None]
) -> tuple[Subset, Method]:
    """Return the smallest subset within the limit, of equals the even one; otherwise all beams."""
    total = len(subsets["even"])
    greedy, evenly = (fewest[name] or total for name in ("greedy", "even"))
    if greedy < evenly:
        return subsets["greedy"][greedy - 1], "greedy"
    return subsets["even"][evenly - 1], "even"


def _exact_gaps(samples: Sequence[MapSample], greedy: Sequence[Subset]) -> tuple[GapPart, ...]:
    """Compare the greedy subset with the best of all subsets, size by size."""
    total = samples[0].scanner.beams
    return tuple(
        GapPart(
            beams=len(subset.beams),
            subsets=math.comb(total, len(subset.beams)),
            greedy_points=objective(samples, subset.beams),
            exact_points=best_of_all(samples, len(subset.beams))[1],
        )
        for subset in greedy
    )


def _exact(
    total: int,
    below: int,
    samples: Sequence[MapSample],
    limit: float,
    measured: Callable[[Kept], Subset],
) -> Subset | None:
    """Return the smallest of all subsets below `below` beams that is within the limit."""
    for count in range(1, below):
        good = [
            measured(beams)
            for beams in combinations(range(total), count)
            if _loss(samples, beams).points <= limit + ROUNDING
        ]
        good = [subset for subset in good if subset.within(limit)]
        if good:
            return min(good, key=lambda subset: subset.checked.points)
    return None


def _random_part(points: list[float], count: int) -> RandomPart:
    return RandomPart(
        beams=count,
        lowest_points=min(points),
        mean_points=float(np.mean(points)),
        highest_points=max(points),
    )


def _sizes(most: int) -> Iterator[int]:
    """Return up to about 20 sizes from 1 to `most`."""
    return iter(sorted({round(size) for size in np.geomspace(1, most, 20)}))
