"""Ensemble: many runs of a localizer along a route: how far off it gets, and how often lost.

The true pose keeps to the route, as in an open-loop drive (`drive_route(..., open_loop=True)`), and
the results are those of such drives in distribution: with the same parameters, but other random
numbers. Monte Carlo localizers and the Kalman filter run without Python in a step; any other
localizer, people, and intensities go through `drive_route`.

An ensemble is of one building, robot, scanner and localizer; what those need is made once, by
`EnsembleRunner`, which then takes routes. `ensemble` is both for a single route.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ambinav.config import NonNegative, as_count, check_fields, check_generator, check_kind
from ambinav.drive.bootstrap import LEVEL, Interval, share
from ambinav.drive.drive import (
    check_parts,
    checked_start,
    checked_timing,
    drive_route,
    make_localizer,
)
from ambinav.drive.localizer_spec import ChosenLocalizer, LocalizerContext, named_localizer
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION, LOST_SECONDS, first_lost
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.people import People
from ambinav.drive.readings import Readings
from ambinav.drive.robot import Robot
from ambinav.drive.schedule import scheduled
from ambinav.forecasting.ensemble_kernel import (
    RouteScans,
    RunStreams,
    drive_kalman,
    drive_particles,
    quick_tables,
)
from ambinav.forecasting.stopping import StoppingRule, confidence_sequence, side
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.filter_state import covariance_roots, filter_state
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.mesh_rays import MeshRays
from ambinav.localization.parameters import MclParameters
from ambinav.localization.random import states as random_states
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats
from ambinav.runtime.threads import run_rows
from ambinav.runtime.threads import share as share_rows
from ambinav.sensing.scanner import RangeScanner

BATCH = 16
"""Runs after which a sequential ensemble looks whether it may stop."""

Errors = NDArray[np.float32]


@dataclass(frozen=True)
class LostRule:
    """A robot is lost whose error is above a limit for longer than `seconds`.

    The defaults are those of `ambinav.drive.metrics`.

    Attributes:
        position: Limit of the position's error, metres: in any direction, or along the heading.
        heading: Limit of the heading's error, radians.
        seconds: For how long an error may be above one of them.
        lateral: Limit of the error across the robot's heading, metres; None: that of the position
            holds in any direction.

    Raises:
        InputError: a number is negative or not finite.
    """

    position: NonNegative = LOST_POSITION
    heading: NonNegative = LOST_HEADING
    seconds: NonNegative = LOST_SECONDS
    lateral: NonNegative | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    def is_off(self, error: Errors, theta: Floats) -> Bools:
        """Return whether errors are above a limit, shape (R, n).

        Args:
            error: Of x, y (metres, map frame) and heading (radians), shape (R, n, 3).
            theta: True heading at each sample, radians, shape (n,).
        """
        x, y, turned = np.moveaxis(error, -1, 0)
        if self.lateral is None:
            off = np.hypot(x, y) > self.position
        else:
            c, s = np.cos(theta), np.sin(theta)
            off = np.abs(c * x + s * y) > self.position
            off |= np.abs(c * y - s * x) > self.lateral
        return np.asarray(off | (np.abs(turned) > self.heading))


@dataclass(frozen=True, eq=False)
class Ensemble:
    """R runs of a localizer along a route, sampled n times.

    Attributes:
        poses: True poses, shape (n, 3), metres and radians, map frame.
        distance: Metres along the route up to each sample, shape (n,).
        time: Seconds from the start, shape (n,).
        error: Estimate minus true pose, float32, shape (R, n, 3): x, y in metres, map frame, and
            heading in radians.
        lost: Which runs were ever lost, bool, shape (R,).
        lost_at: Metres along the route where they were first lost, shape (R,); nan if never.
        probability: Share of runs that got lost. Its interval is Wilson's, and where the runs ended
            before the largest number a confidence sequence's (`stopping`), each with half of the
            error probability.
        threshold: Share that the interval is compared with; None: none.
        side: "below" or "above" if the interval lies wholly on one side of the threshold; None if
            it does not, or there was none.
    """

    poses: Floats
    distance: Floats
    time: Floats
    error: Errors
    lost: Bools
    lost_at: Floats
    probability: Interval
    threshold: float | None
    side: str | None

    def __len__(self) -> int:
        """Return the number of runs R."""
        return len(self.lost)

    def __repr__(self) -> str:
        """Return length and lost runs as text."""
        return f"<Ensemble over {self.distance[-1]:.1f} m: {self.sentence}>"

    @property
    def sentence(self) -> str:
        """Number of lost robots, and on which side of the threshold their share is."""
        interval = self.probability.scaled(100.0)
        text = (
            f"{int(self.lost.sum())} of {len(self)} driven robots got lost: "
            f"{interval.low:.1f} to {interval.high:.1f} %"
        )
        if self.threshold is None:
            return f"{text}."
        share = f"{100.0 * self.threshold:g} %"
        if self.side is None:
            return f"{text}; whether that is less than {share} is undecided."
        return f"{text}, {'less' if self.side == 'below' else 'more'} than {share}."

    @property
    def lost_share(self) -> Floats:
        """Share of runs that were lost at each sample or before it, shape (n,)."""
        lost_at = np.sort(self.lost_at[self.lost])
        return np.searchsorted(lost_at, self.distance, side="right") / len(self)


def ensemble(
    environment: Environment,
    scanner: RangeScanner,
    route: Route,
    localizer: ChosenLocalizer | MclParameters | str,
    rng: np.random.Generator,
    runs: int = 32,
    *,
    robot: Robot | None = None,
    noise: OdometryNoise | None = None,
    world: Environment | None = None,
    people: People | None = None,
    start_std: ArrayLike = (0.05, 0.05, 0.02),
    rate: float = 10.0,
    speed: float | None = None,
    lost: LostRule | None = None,
    until: float | None = None,
    width: float | None = None,
    level: float = LEVEL,
) -> Ensemble:
    """Run a localizer many times along a route; see `EnsembleRunner` for many routes.

    Run k does not depend on the number of runs nor on the threads.

    Args:
        environment: The map of the localizer.
        scanner: The scanner of the robot.
        route: The route.
        localizer: As for `drive_route`, but not one that is made already.
        rng: The source of randomness; the same seed gives the same runs.
        runs: Number of runs, R; the largest number with `until` or `width`.
        robot: The robot; None: the default one.
        noise: Errors of the odometry; None: the default ones.
        world: The true building; None: it is as on the map.
        people: People who walk around.
        start_std: Deviations of x, y (metres) and heading (radians) of the first estimate, known to
            the localizer.
        rate: Time steps per second.
        speed: Speed on a free straight path, metres per second; None: the follower's.
        lost: When a robot is lost.
        until: Stop when the interval of the share of lost runs lies wholly below or above this.
        width: Stop when it is no wider than this.
        level: Level of the interval; with `until` or `width` of the verdict, whenever it falls.

    Raises:
        InputError: the start is not free, a number is out of its range, the localizer's name is
            unknown, or an argument is refused by its class.
    """
    runner = EnsembleRunner(
        environment, scanner, localizer, robot=robot, noise=noise, world=world, people=people,
        start_std=start_std, rate=rate, speed=speed,
    )  # fmt: skip
    return runner.drive(route, rng, runs, lost=lost, until=until, width=width, level=level)


def least_shown(runs: int, level: float = LEVEL) -> float:
    """Return the upper end of the share of lost robots where none of so many runs gets lost."""
    return share(np.zeros(runs, dtype=bool), _half(level)).high


def _half(level: float) -> float:
    """Return the level at which half of the error probability is left."""
    return 0.5 * (1.0 + level)


class EnsembleRunner:
    """Prepared ensembles of one localizer in one building; see `ensemble` for the arguments.

    Attributes:
        compiled: Whether the runs take no Python in a step.
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        localizer: ChosenLocalizer | MclParameters | str,
        *,
        robot: Robot | None = None,
        noise: OdometryNoise | None = None,
        world: Environment | None = None,
        people: People | None = None,
        start_std: ArrayLike = (0.05, 0.05, 0.02),
        rate: float = 10.0,
        speed: float | None = None,
        lost: LostRule | None = None,
    ) -> None:
        self._environment = environment
        self._lost = LostRule() if lost is None else lost
        self._scanner = scanner
        self._robot = Robot() if robot is None else robot
        self._noise = OdometryNoise() if noise is None else noise
        self._world = environment if world is None else world
        self._people = people
        check_parts(environment, scanner, self._robot, self._world, self._noise, people)
        check_kind(self._lost, LostRule, "lost")
        self._deviations = checked_timing(rate, start_std, None)
        self._rate = rate
        self._follower = FollowerParameters()
        if speed is not None:
            self._follower = FollowerParameters(desired_linear_vel=speed)
        if isinstance(localizer, str):
            localizer = named_localizer(localizer, scanner, self._noise, self._robot, rate)
        self._localizer = localizer
        context = LocalizerContext(environment, scanner, self._noise, 1, np.random.default_rng(0))
        made = make_localizer(localizer, context, self._robot, rate)
        self._particles, self._kalman = None, None
        if isinstance(made, MonteCarloLocalizer) and not made.reads_intensities:
            self._particles = made
        if isinstance(made, ExtendedKalmanFilter) and not made.reads_intensities:
            # In a mesh rays are cast outside of kernels.
            self._kalman = None if isinstance(made.cast, MeshRays) else made
        empty = people is None or people.count == 0
        self.compiled = empty and (self._particles or self._kalman) is not None
        self._quick, beams = None, None
        if self.compiled and self._particles is not None:
            # The other beams need not be simulated.
            model = self._particles.model
            self._quick, beams = quick_tables(model), model.beam
            self._model = model._replace(beam=np.arange(len(beams)))
        self._readings = Readings(self._world, scanner, beams)
        self._checker = CollisionChecker(
            self._world, self._robot.footprint, Steering(), simulated=True
        )

    def drive(
        self,
        route: Route,
        rng: np.random.Generator,
        runs: int = 32,
        *,
        lost: LostRule | None = None,
        until: float | None = None,
        width: float | None = None,
        level: float = LEVEL,
    ) -> Ensemble:
        """Run the localizer many times along a route; see `ensemble`."""
        runs = as_count(runs, "runs")
        check_kind(route, Route, "route")
        check_generator(rng)
        lost = self._lost if lost is None else lost
        check_kind(lost, LostRule, "lost")
        rule = StoppingRule(threshold=until, width=width)
        sequential = until is not None or width is not None
        confidence_sequence(0, 0, level)
        # Half of it is for the looks before the last run, half for the last.
        half = _half(level)
        checked_start(route, self._checker)
        path = scheduled(
            route.poses, route.steering, self._robot, self._follower.desired_linear_vel,
            1.0 / self._rate,
        )  # fmt: skip
        time = np.arange(len(path)) / self._rate
        parts: list[Errors] = []
        lost_after: list[float] = []
        for error in self._batches(path, route, rng, runs, BATCH if sequential else runs):
            parts.append(error)
            far = lost.is_off(error, path[:, 2])
            lost_after += [first_lost(time, row, lost.seconds) for row in far]
            events = int(np.isfinite(lost_after).sum())
            interval = confidence_sequence(events, len(lost_after), half)
            if sequential and rule.met(interval):
                break
        after = np.array(lost_after)
        is_lost = np.isfinite(after)
        probability = share(is_lost, half if sequential else level)
        if sequential and len(after) < runs:
            probability = interval
        steps = np.diff(path[:, :2], axis=0, prepend=path[:1, :2])
        distance = np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))
        lost_at = np.full(len(after), math.nan)
        lost_at[is_lost] = np.interp(after[is_lost], time, distance)
        return Ensemble(
            path, distance, time, np.concatenate(parts), is_lost, lost_at, probability, until,
            None if until is None else side(probability, until),
        )  # fmt: skip

    def _batches(
        self, path: Floats, route: Route, rng: np.random.Generator, runs: int, size: int
    ) -> Iterator[Errors]:
        """Yield the errors of `size` runs after the other, float32, (size, n, 3)."""
        scans = self._scans(path) if self.compiled else None
        # One stream for every BATCH runs: each is the same whatever the number of runs.
        children = rng.spawn(1)[0].spawn(-(-runs // BATCH))
        for low in range(0, runs, size):
            count = min(size, runs - low)
            streams = children[low // BATCH : -(-(low + count) // BATCH)]
            sizes = [BATCH] * (len(streams) - 1) + [count - BATCH * (len(streams) - 1)]
            pairs = list(zip(streams, sizes, strict=True))
            if scans is None:
                yield np.concatenate([self._driven(route, *pair) for pair in pairs])
                continue
            rows = [[random_states(s, n) for s in stream.spawn(4)] for stream, n in pairs]
            errors = np.empty((count, len(path), 3), dtype=np.float32)
            self._run(scans, RunStreams(*map(np.concatenate, zip(*rows, strict=True))), errors)
            yield errors

    def _scans(self, path: Floats) -> RouteScans:
        """Return what the runs along a path have in common."""
        mean, std = self._readings.moments(self._readings.true_ranges(path))
        return RouteScans(
            path, mean, std, self._readings.sensors, self._deviations, self._noise.packed
        )

    def _run(self, scans: RouteScans, streams: RunStreams, errors: Errors) -> None:
        """Run the compiled localizer; write the errors, shape (R, n, 3)."""
        covariance = np.diag(self._deviations**2)
        kalman, particles = self._kalman, self._particles
        if kalman is not None:
            run_rows(
                drive_kalman, len(errors), scans, streams, covariance, kalman.odometry.array,
                kalman.gate, kalman.cast, kalman.noise, errors,
            )  # fmt: skip
        if particles is not None:
            root = covariance_roots(covariance[None])[0]

            def run_some(low: int, high: int) -> None:
                # A filter for each thread, which stays in its cache.
                state = filter_state(particles.parameters, 1, np.zeros((1, 4), dtype=np.uint64))
                drive_particles(
                    low, high, scans, streams, root, self._model, particles.cast, self._quick,
                    True if self._quick is None else None, state, errors,
                )  # fmt: skip

            share_rows(run_some, len(errors))

    def _driven(self, route: Route, rng: np.random.Generator, runs: int) -> Errors:
        """Return the errors of ordinary drives."""
        drives = drive_route(
            self._environment, self._scanner, self._robot, route, self._localizer, rng, runs,
            world=self._world, follower=self._follower, noise=self._noise, people=self._people,
            open_loop=True, rate=self._rate, start_std=self._deviations,
        )  # fmt: skip
        return drives.errors().astype(np.float32)
