"""Monte Carlo localization of a log in a map: start, replay and summary."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.geometry.environment import Environment
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.logs.log import Log
from ambinav.logs.replay import Replay, replay
from ambinav.runtime.errors import InputError

SPARSE_SCANS: Final = MclParameters(
    laser_model_type="likelihood_field_prob",
    importance_factor=0.3,
    alpha1=0.01,
    alpha2=0.01,
    alpha3=0.01,
    alpha4=0.01,
)
"""Parameters for logs of lasers that were thinned to a scan every metre or two.

With AMCL's defaults the robot gets lost on such logs: alphas of 0.2 spread the particles by 0.45 m
for each metre between two scans, and the sum of cubes weighs the best of them only a few times as
much as the worst. Where scans are 0.2 to 0.4 m apart, correcting one of the two is enough; at 1 to
2 m it takes both (benchmarks/results/replay.md).
"""

START_STD: Final = (0.1, 0.1, 0.05)
"""Deviations of the first estimate: metres, metres, radians."""


def localize(
    log: Log,
    environment: Environment,
    parameters: MclParameters | None = None,
    *,
    rng: np.random.Generator,
    runs: int = 1,
    start: ArrayLike | None = None,
    start_std: ArrayLike = START_STD,
    field: LikelihoodField | None = None,
) -> Replay:
    """Replay a log through Monte Carlo localization, with a scanner of the log's own beams.

    Args:
        log: The log.
        environment: The map.
        parameters: Parameters of the localizer; None: AMCL's defaults (see also `SPARSE_SCANS`).
        rng: The source of randomness; the same seed gives the same estimates.
        runs: How many times, each with random numbers of its own.
        start: Where the robot is believed to be at first, (3,): x, y, theta, map frame; None:
            the log's first pose.
        start_std: Deviations of that belief: x, y (metres), theta (radians).
        field: See `MonteCarloLocalizer`.

    Raises:
        InputError: the log has no poses and no start is given, fewer than half of its poses lie
            in the free space, the start does not, or what the localizer refuses.
    """
    if log.poses is not None:
        log.check_environment(environment)
    where = log.source or f"log {log.name!r}"
    first = log.required_poses()[0] if start is None else np.array(start, dtype=np.float64)
    if first.shape != (3,) or not environment.is_free(float(first[0]), float(first[1])):
        raise InputError(
            f"{where}: the replay's start, {first.tolist()}, is not x, y, theta in the free space "
            f"of environment {environment.name!r}; give a start there."
        )
    std = np.array(start_std, dtype=np.float64)
    if std.shape != (3,) or not (np.isfinite(std) & (std >= 0.0)).all():
        raise InputError(
            f"start_std is {std.tolist()}; give the deviations of x, y and heading, at least 0."
        )
    localizer = MonteCarloLocalizer(
        environment, log.scanner(), parameters, runs=runs, rng=rng, field=field
    )
    localizer.start(first, np.diag(std**2))
    return replay(log, localizer)
