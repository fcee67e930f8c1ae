"""Monte Carlo localization as in AMCL, for many runs at once, each with its own filter.

`mcl_update` has the filter itself, for other kernels too.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_count
from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables
from ambinav.localization.filter_state import (
    FilterModel,
    FilterState,
    covariance_roots,
    filter_model,
    filter_state,
    filter_tables,
)
from ambinav.localization.intensity import beside_ranges, intensity_model
from ambinav.localization.likelihood_field import LikelihoodField
from ambinav.localization.mcl_update import start_run, start_run_globally, update_run
from ambinav.localization.parameters import MclParameters
from ambinav.localization.random import states
from ambinav.localization.scanner_settings import unsuited
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

# Minimum number of runs per thread. An update takes half a millisecond, and waking a thread
# on a busy machine several.
LEAST_RUNS = 4


class MonteCarloLocalizer:
    """Monte Carlo localization in one environment, for any number of runs at once.

    Args:
        environment: The map that the robot has.
        scanner: Its scanner.
        parameters: See `MclParameters`; None: AMCL's defaults for a laser, and for a scanner with
            cones those of `MclParameters.for_scanner`.
        runs: How many robots are localized side by side.
        rng: Where each run's own random numbers start from.
        field: A likelihood field of the environment made before; None: it is made here.

    A likelihood field and a scanner with cones give an `InputWarning`.

    Raises:
        InputError: an argument cannot be used.
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        parameters: MclParameters | None = None,
        *,
        runs: int = 1,
        rng: np.random.Generator,
        field: LikelihoodField | None = None,
    ) -> None:
        if parameters is None:
            parameters = MclParameters.for_scanner(scanner)
        note = unsuited(parameters.laser_model_type, scanner)
        if note is not None:
            warnings.warn(note, InputWarning, stacklevel=2)
        self.parameters = parameters
        self.scanner = scanner
        self.runs = as_count(runs, "runs")
        self.model: FilterModel = filter_model(environment, scanner, self.parameters, field)
        self.cast: CastTables | None = filter_tables(environment, scanner, self.model)
        self.channel = intensity_model(environment, scanner, parameters, self.model, field)
        self.state: FilterState = filter_state(self.parameters, self.runs, states(rng, self.runs))

    def start(self, poses: ArrayLike, covariance: ArrayLike | None = None) -> None:
        """Spread particles about a pose for each run; the next scan is used at once.

        Args:
            poses: Shape (R, 3), or (3,) for all runs, map frame.
            covariance: Shape (3, 3) or (R, 3, 3); None: the parameters' initial_cov_xx, _yy, _aa.

        Raises:
            InputError: a shape does not fit, a value is not finite, or a covariance has a
                negative eigenvalue.
        """
        p = self.parameters
        if covariance is None:
            covariance = np.diag([p.initial_cov_xx, p.initial_cov_yy, p.initial_cov_aa])
        mean = self._rows(poses, "poses", (3,))
        spread = self._rows(covariance, "covariance", (3, 3))
        _start_all(np.ascontiguousarray(mean), covariance_roots(spread), self.model, self.state)

    def start_globally(self) -> None:
        """Spread the particles evenly over the free space and all headings, in every run."""
        _start_all_globally(self.model, self.state)

    @property
    def reads_intensities(self) -> bool:
        """True if `update` uses intensities: it needs a channel, and reflectors on the map."""
        return self.channel is not None

    def update(
        self, odometry: ArrayLike, ranges: ArrayLike, intensities: ArrayLike | None = None
    ) -> Bools:
        """Update with each robot's odometry pose, and the scan made there.

        Args:
            odometry: Poses in the odometry frame, shape (R, 3), or (3,) for one run.
            ranges: Readings, shape (R, B), or (B,) for one run: metres, inf no echo, -inf too
                near, nan no reading.
            intensities: Beside them, of the same shape, nan for none; None: of no beam.

        Returns:
            Shape (R,): which runs took the scan in; the others have moved less than
            update_min_d and update_min_a since their last one.

        Raises:
            InputError: a shape does not fit, a pose is not finite, or the localizer has not been
                started.
        """
        if (self.state.number == 0).any():
            raise InputError("the localizer has no particles; call start or start_globally first.")
        poses = self._rows(odometry, "odometry", (3,))
        readings = np.ascontiguousarray(ranges, dtype=np.float32)
        shape = (self.runs, self.scanner.beams)
        if readings.shape != shape and (self.runs != 1 or readings.shape != shape[1:]):
            raise InputError(
                f"ranges have the shape {readings.shape}; give {shape}: the {shape[1]} beams of "
                f"scanner {self.scanner.name!r} for each of {self.runs} runs."
            )
        channel = None if intensities is None else self.channel
        beside = beside_ranges(channel, intensities, readings)
        updated = np.empty(self.runs, dtype=np.bool_)
        run_rows(
            _update, self.runs, poses, readings.reshape(shape), self.model, self.cast, self.state,
            updated, channel, beside, least=LEAST_RUNS,
        )  # fmt: skip
        return updated

    @property
    def mean(self) -> Floats:
        """Estimated pose of each run, shape (R, 3), metres and radians, map frame."""
        return self.state.mean.copy()

    @property
    def covariance(self) -> Floats:
        """Covariance of the estimate: second moment of all particles about it, (R, 3, 3)."""
        return self.state.covariance.copy()

    @property
    def counts(self) -> Ints:
        """Number of particles of each run, shape (R,)."""
        return self.state.number.copy()

    def particles(self, run: int = 0) -> tuple[Floats, Floats]:
        """Return poses (n, 3) and weights (n,) of a run's particles at its last update."""
        rows = self.state.particles[run, : self.state.number[run]]
        return rows[:, :3].copy(), rows[:, 3].copy()

    def _rows(self, values: ArrayLike, name: str, shape: tuple[int, ...]) -> Floats:
        array = np.asarray(values, dtype=np.float64)
        if array.shape not in (shape, (self.runs, *shape)):
            raise InputError(
                f"{name}: the shape is {array.shape}; give {(self.runs, *shape)} for {self.runs} "
                "runs."
            )
        if not np.isfinite(array).all():
            raise InputError(f"{name}: a value is not finite; give metres and radians.")
        return np.array(np.broadcast_to(array, (self.runs, *shape)))


@kernel
def _update(low, high, poses, ranges, model, cast, state, updated, channel, intensities):
    for r in range(low, high):
        updated[r] = update_run(
            r, poses[r, 0], poses[r, 1], poses[r, 2], ranges[r], model, cast, state, channel,
            intensities[r],
        )  # fmt: skip


@kernel
def _start_all(mean, root, model, state):
    for r in range(mean.shape[0]):
        start_run(r, mean[r], root[r], model, state)


@kernel
def _start_all_globally(model, state):
    for r in range(state.number.size):
        start_run_globally(r, model, state)
