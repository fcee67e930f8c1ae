"""Driving of a route with a localizer in the loop, many runs at once."""

from __future__ import annotations

import math
from types import NoneType
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_array, as_count, as_positive, check_generator, check_kind
from ambinav.config.numbers import shown
from ambinav.drive.course import Course
from ambinav.drive.drives import Drives, Recorder
from ambinav.drive.localizer_spec import ChosenLocalizer, LocalizerContext, named_localizer
from ambinav.drive.localizers import Localizer, reads_intensities, updated
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.parameters import FollowerParameters
from ambinav.drive.people import Crowd, People
from ambinav.drive.readings import Readings, standard_normals
from ambinav.drive.robot import Robot
from ambinav.drive.robots import Robots
from ambinav.drive.schedule import scheduled
from ambinav.drive.world import DRIVING, TIMED_OUT
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.motion.steering import Steering
from ambinav.localization.random import states as random_states
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

if TYPE_CHECKING:
    from ambinav.localization.parameters import MclParameters

# A run may take this many times as long as the route's length and turns need at full speed, and
# so many seconds more.
PATIENCE, SPARE = 3.0, 10.0


class Controller(Protocol):
    """Controller of R robots, made for one drive; it may keep a state."""

    def command(
        self, belief: Floats, covariance: Floats, speeds: Floats, ranges: Floats32
    ) -> Floats:
        """Return the command of each robot, speed (m/s) and turn rate (rad/s), shape (R, 2).

        Args:
            belief: Estimated poses, shape (R, 3), metres and radians, map
                frame.
            covariance: Covariance of the estimate, shape (R, 3, 3); zero if it is the true pose.
            speeds: Speed and turn rate, shape (R, 2).
            ranges: Readings, shape (R, B), metres: inf no echo, -inf too near.
        """


def drive_route(
    environment: Environment,
    scanner: RangeScanner,
    robot: Robot,
    route: Route,
    localizer: ChosenLocalizer | Localizer | MclParameters | str,
    rng: np.random.Generator,
    runs: int = 30,
    *,
    world: Environment | None = None,
    follower: FollowerParameters | None = None,
    noise: OdometryNoise | None = None,
    people: People | None = None,
    open_loop: bool = False,
    rate: float = 10.0,
    start_std: ArrayLike = (0.05, 0.05, 0.02),
    max_time: float | None = None,
    keep_ranges: bool = False,
    controller: Controller | None = None,
) -> Drives:
    """Drive a route many times; runs differ only in their random numbers.

    In each time step the robot reads its scanner and its odometry, the localizer updates its
    estimate, the follower steers by the estimate, and the simulated robot moves. A run ends when
    the estimate is at the goal, when the robot touches a wall, or after `max_time`. Run k does not
    depend on the number of runs, if that holds for the localizer.

    Monte Carlo localization shares the runs among as many threads as numba is set to, in each time
    step. With other load on the processor these threads wait for each other: processes that drive
    in parallel should call `numba.set_num_threads(1)` first.

    Args:
        environment: The map of the localizer.
        scanner: The scanner of the robot.
        robot: The robot.
        route: The route; planned for `robot.footprint`, or it may lead the robot into walls.
        localizer: A name of `LOCALIZERS`, with parameters that suit scanner and odometry; one that
            is chosen with its parameters; parameters of Monte Carlo localization; or a localizer
            made for this number of runs, such as an `ExtendedKalmanFilter`.
        rng: The source of randomness; the same seed gives the same drives.
        runs: Number of runs, R.
        world: The true building, if it differs from the map (see `clutter`).
        follower: Parameters of the follower.
        noise: Errors of the odometry.
        people: People who walk around.
        open_loop: Keep the true pose on the route, whatever the estimate; the run ends at the goal.
        rate: Time steps per second.
        start_std: Deviations of x, y (metres) and heading (radians) of the first estimate, known to
            the localizer.
        max_time: Maximum duration of a run, seconds; default: three times the time of the route's
            length and turns at full speed, plus 10 s.
        keep_ranges: Keep all readings.
        controller: Steers instead of the follower; only start, goal and length of the route are
            then used. It has no effect in an open-loop drive.

    Raises:
        InputError: the start is not free, there are no runs, a number is out of its range, the
            localizer's name is unknown, a command of the controller cannot be driven, or an
            argument is refused by its class.
    """
    follower = FollowerParameters() if follower is None else follower
    noise = OdometryNoise() if noise is None else noise
    world = environment if world is None else world
    check_parts(environment, scanner, robot, world, noise, people)
    check_kind(route, Route, "route")
    check_kind(follower, FollowerParameters, "follower")
    runs = as_count(runs, "runs")
    check_generator(rng)
    deviations = checked_timing(rate, start_std, max_time)
    course = Course.of(route.poses, route.steering)
    checker = CollisionChecker(world, robot.footprint, Steering(), simulated=True)
    start = checked_start(route, checker)
    # Streams of their own, so that what one part draws changes nothing for the others.
    *streams, localizer_rng = rng.spawn(5)
    odometry_states, reading_states, walkers, start_states = (
        random_states(stream, runs) for stream in streams
    )
    dt, path = 1.0 / rate, None
    if open_loop:
        path = scheduled(route.poses, route.steering, robot, follower.desired_linear_vel, dt)
        steps = len(path)
    else:
        steps = 1 + math.ceil(_patience(course, robot, follower, max_time) * rate)
    robots = Robots(start, robot, course, follower, noise, checker, odometry_states, dt, path)
    sight, crowd = Readings(world, scanner), None
    if people is not None and people.count:
        crowd = Crowd(world, people, robot.radius, robots.truth, walkers)
    context = LocalizerContext(environment, scanner, noise, runs, localizer_rng)
    estimator = make_localizer(localizer, context, robot, rate)
    covariance = np.zeros((runs, 3, 3))
    if estimator is not None:
        estimator.start(
            robots.truth + deviations * standard_normals(start_states, 3), np.diag(deviations**2)
        )
    # Simulated only if they are read, so that all other random numbers stay the same.
    hears = estimator is not None and reads_intensities(estimator)
    intensity_states = random_states(localizer_rng.spawn(1)[0], runs) if hears else None
    intensities = None
    record = Recorder(runs, steps, scanner.beams if keep_ranges else None)
    ranges = np.empty((runs, 0), dtype=np.float32)
    fresh = np.zeros(runs, dtype=np.bool_)
    going = np.ones(runs, dtype=np.bool_)
    steered = None if open_loop else controller
    looks = keep_ranges or estimator is not None or steered is not None
    for k in range(steps):
        if looks:
            others = () if crowd is None else (crowd.places, crowd.people.radius)
            if intensity_states is None:
                ranges = sight.capture(sight.true_ranges(robots.truth, *others), reading_states)
            else:
                true, reflects = sight.look(robots.truth, *others)
                ranges = sight.capture(true, reading_states)
                intensities = sight.intensities(reflects, ranges, intensity_states)
        belief = robots.truth.copy()
        if estimator is not None:
            fresh = updated(estimator, robots.odometry.copy(), ranges, intensities)
            belief, covariance = estimator.mean, estimator.covariance
        record.add(going, (robots.truth, robots.odometry, belief), covariance, fresh, ranges)
        if k + 1 == steps and not open_loop:
            robots.outcome[robots.outcome == DRIVING] = TIMED_OUT
        command = None
        if steered is not None:
            command = _checked_command(
                steered.command(belief, covariance, robots.speeds, ranges), going
            )
        going = robots.step(belief, command)
        if not going.any():
            break
        if crowd is not None:
            crowd.walk(robots.truth, dt)
    return record.drives(dt, robots.outcome, course.goal, course.length, open_loop)


def check_parts(
    environment: Environment,
    scanner: RangeScanner,
    robot: Robot,
    world: Environment,
    noise: OdometryNoise,
    people: People | None,
) -> None:
    """Check the kinds of what a drive is made of; raise `InputError` for another."""
    check_kind(environment, Environment, "environment")
    check_kind(scanner, RangeScanner, "scanner")
    check_kind(robot, Robot, "robot")
    check_kind(world, Environment, "world")
    check_kind(noise, OdometryNoise, "noise")
    check_kind(people, (People, NoneType), "people")


def _checked_command(command: Floats, going: Bools) -> Floats:
    """Return a controller's commands; raise `InputError` where they cannot be driven."""
    wish = f"speed and turn rate of each robot, finite, shape ({len(going)}, 2)"
    out = as_array(command, "controller: the command", wish)
    if out.shape != (len(going), 2) or not np.isfinite(out[going]).all():
        raise InputError(f"controller: the command is {shown(out.tolist())}; give {wish}.")
    return out


def checked_timing(rate: float, start_std: ArrayLike, max_time: float | None) -> Floats:
    """Return the deviations of the start; raise `InputError` for unusable numbers."""
    as_positive(rate, "rate", "time steps a second")
    if max_time is not None:
        as_positive(max_time, "max_time", "seconds")
    return checked_start_std(start_std)


def checked_start_std(start_std: ArrayLike) -> Floats:
    """Return the deviations of the start, shape (3,); raise `InputError` for unusable ones."""
    try:
        deviations = np.array(start_std, dtype=np.float64)
    except (TypeError, ValueError):
        deviations = np.empty(0)
    if deviations.shape != (3,) or not (np.isfinite(deviations) & (deviations > 0.0)).all():
        raise InputError(
            f"start_std is {shown(start_std)}; give the deviations of x, y and heading, above 0."
        )
    return deviations


def checked_start(route: Route, checker: CollisionChecker) -> Floats:
    """Return the first pose; raise `InputError` where the robot does not fit there."""
    start: Floats = route.steering.oriented(route.poses)[0]
    why = checker.why_not(*start.tolist())
    if why is not None:
        raise InputError(
            f"route: its start, ({start[0]:.2f}, {start[1]:.2f}) m, is {why}; "
            "give a route that starts where the robot fits."
        )
    return start


def _patience(
    course: Course, robot: Robot, follower: FollowerParameters, limit: float | None
) -> float:
    """Return the seconds after which a run is aborted."""
    if limit is not None:
        return limit
    speed = min(robot.max_speed, follower.desired_linear_vel)
    turning = min(robot.max_turn_rate, follower.rotate_to_heading_angular_vel)
    return PATIENCE * (course.length / speed + course.turn / turning) + SPARE


def make_localizer(
    localizer: ChosenLocalizer | Localizer | MclParameters | str,
    context: LocalizerContext,
    robot: Robot,
    rate: float,
) -> Localizer | None:
    """Return the chosen localizer; None knows the truth."""
    from ambinav.drive.own_localizers import monte_carlo
    from ambinav.localization.parameters import MclParameters

    if isinstance(localizer, str):
        localizer = named_localizer(localizer, context.scanner, context.noise, robot, rate)
    if isinstance(localizer, ChosenLocalizer):
        return localizer.make(context)
    if isinstance(localizer, MclParameters):
        return monte_carlo(localizer, context)
    if localizer is not None and not callable(getattr(localizer, "start", None)):
        raise InputError(
            f"localizer is {shown(localizer)}; give a name, MclParameters, a localizer, or of a "
            "LocalizerClass what its `chosen(scanner, noise)` returns."
        )
    return localizer
