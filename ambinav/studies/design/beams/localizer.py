"""Time that a localizer saves with fewer beams, and the accuracy that it loses."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Annotated, Final

import numpy as np
from pydantic import Field

from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.information import scan_information
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.reports.fields import Part, rounded
from ambinav.runtime.array_types import Floats
from ambinav.sensing.scanner import RangeScanner
from ambinav.studies.design.beams.sample import rng_of

ROBOTS: Final = 4
"""So few that the calling thread does it alone, whose processor time is taken: other work on the
machine then hardly shows."""
PARTICLES: Final = 1000
ROUNDS: Final = 25
STEP: Final = 0.05
"""Metres between two scans: each is taken in."""
SPACING: Final = 0.2
"""Metres between the places that poses are drawn from."""
POSES: Final = 300
PRIOR: Final = (0.1, 0.1, 0.05)
"""Deviations of a pose before its scan: metres, metres, radians."""

Share = Annotated[float, rounded(4)]
Milliseconds = Annotated[float, rounded(5)]


class UpdatePart(Part):
    """Median processor time of one update of one robot, with all and with fewer beams.

    Both scanners are timed alternately in one run; the ratios are those of its rounds.
    """

    localizer: str
    all_ms: Milliseconds = Field(description="processor time of one robot")
    kept_ms: Milliseconds
    ratio: Share = Field(description="median")
    lowest_ratio: Share
    highest_ratio: Share


class InformationPart(Part):
    """Standard deviation of the position after one scan, averaged over poses.

    By the Kalman filter's model: beam errors are independent.
    """

    all_m: Annotated[float, rounded(5)]
    kept_m: Annotated[float, rounded(5)]


def update_times(
    env: Environment, scanner: RangeScanner, subset: RangeScanner, rng: np.random.Generator
) -> tuple[UpdatePart, ...]:
    """Time Monte Carlo localization and the Kalman filter; neither skips beams by itself.

    Args:
        env: The building; the robots stand at random places of it.
        scanner: Scanner with all beams.
        subset: Same with the kept beams.
        rng: Draws places and readings.
    """
    poses = _poses(env, scanner, rng, ROBOTS)
    spread = np.diag([0.01, 0.01, 0.0025])
    named: dict[str, Callable[[RangeScanner], MonteCarloLocalizer | ExtendedKalmanFilter]] = {
        f"Monte Carlo localization ({PARTICLES} particles)": lambda mounted: MonteCarloLocalizer(
            env, mounted, _all_beams(mounted), runs=len(poses), rng=np.random.default_rng(1)
        ),
        "Kalman filter": lambda mounted: ExtendedKalmanFilter(env, mounted, runs=len(poses)),
    }
    times = []
    for title, make in named.items():
        seconds: list[list[float]] = [[], []]
        cases = [
            (make(timed), timed.read(env, poses[:, 0], poses[:, 1], poses[:, 2], rng), samples)
            for timed, samples in zip((scanner, subset), seconds, strict=True)
        ]
        for localizer, _, _ in cases:
            localizer.start(poses, spread)
        # The first round compiles, and starts the filters.
        for number in range(ROUNDS + 1):
            odometry = np.zeros_like(poses)
            odometry[:, 0] = STEP * (number % 2)
            for localizer, ranges, samples in cases:
                before = time.thread_time()
                localizer.update(odometry, ranges)
                if number:
                    samples.append(time.thread_time() - before)
        each = np.array(seconds) * 1e3 / len(poses)
        ratio = each[1] / each[0]
        times.append(
            UpdatePart(
                localizer=title,
                all_ms=float(np.median(each[0])),
                kept_ms=float(np.median(each[1])),
                ratio=float(np.median(ratio)),
                lowest_ratio=float(ratio.min()),
                highest_ratio=float(ratio.max()),
            )
        )
    return tuple(times)


def scan_information_of(
    buildings: Sequence[Environment],
    scanner: RangeScanner,
    subset: RangeScanner,
    seed: int,
    map_std: float | None = None,
) -> InformationPart:
    """Compute how well one scan locates a robot whose prior deviation is `PRIOR`.

    Here every beam errs by itself: noise averages out over beams, as it does in a simulation and
    as the map, which counts pieces of evidence, does not say.

    Args:
        buildings: The buildings; all count alike.
        scanner: Scanner with all beams.
        subset: Same with the kept beams.
        seed: Seed of the poses.
        map_std: Standard deviation of the walls' position, metres; None: each building's own.
    """
    prior = np.linalg.inv(np.diag(np.square(PRIOR)))
    deviations = np.empty((len(buildings), 2))
    for number, env in enumerate(buildings):
        poses = _poses(env, scanner, rng_of(env, seed, "scan"), POSES)
        for column, beams in enumerate((scanner, subset)):
            covariance = np.linalg.inv(scan_information(env, beams, poses, map_std) + prior)
            error = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1])
            deviations[number, column] = error.mean()
    full, few = deviations.mean(axis=0).tolist()
    return InformationPart(all_m=full, kept_m=few)


def _poses(env: Environment, scanner: RangeScanner, rng: np.random.Generator, count: int) -> Floats:
    """Sample poses at which the robot can stand, all at one heading, shape (count or fewer, 3)."""
    x, y = Lattice.over(env, SPACING).points
    place = rng.permutation(len(x))[: 20 * count]
    theta = float(rng.uniform(-np.pi, np.pi))
    place = place[can_stand(env, scanner, x[place], y[place], theta)][:count]
    return np.column_stack([x[place], y[place], np.full(len(place), theta)])


def _all_beams(scanner: RangeScanner) -> MclParameters:
    """Return parameters for the scanner that use every beam and every scan."""
    return MclParameters.for_scanner(
        scanner,
        max_beams=max(scanner.beams, 2),
        update_min_d=0.0,
        update_min_a=0.0,
        min_particles=PARTICLES,
        max_particles=PARTICLES,
    )
