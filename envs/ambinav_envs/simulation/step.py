"""One step of robots in a building: act, move, sense, localize, judge, observe.

Each robot's numbers depend on nothing but its own record: how many there are and how threads share
them changes no bit.
"""

from __future__ import annotations

import math

from ambinav.drive.follower import limited
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION
from ambinav.drive.noise import propagate_covariance, sample_ground
from ambinav.drive.world import free_share, path, unicycle
from ambinav.localization.ekf_update import update_pose
from ambinav.localization.odometry import wrapped
from ambinav.localization.random import ziggurat
from ambinav.runtime.kernels import kernel
from ambinav.service.motion import integral_straight
from ambinav_envs.buildings.geodesic import distance_at
from ambinav_envs.simulation.belief import score, share_of
from ambinav_envs.simulation.layout import (
    ARRIVED,
    CLUTTER,
    COLLIDED,
    COST,
    COST_COLLISION,
    COST_LOST,
    DECLARED_ARRIVED,
    DECLARED_LOST,
    EKF,
    ERROR,
    ESTIMATE,
    EXPOSURE,
    LOST,
    MCL,
    MISSED,
    MOTION_NOISE,
    ODOMETRY,
    PERFECT,
    REWARD,
    RUNNING,
    SHORTEST,
    START,
    TIMEOUT,
    TRAVELLED,
    TRUE_POSE,
    VALUES,
    WALKERS,
    WEIGHTED,
    Terms,
)
from ambinav_envs.simulation.observe import observe
from ambinav_envs.simulation.obstacles import clutter, free_share_of_boxes, gather, walk
from ambinav_envs.simulation.scanner_kernel import sense

# What `advance` does. A localizer that is no kernel comes between the scan and the rest. What is in
# `WORLD` happens among the walls as they are, the rest is about the map.
PLACE, DRIVE, SENSE, JUDGE, OBSERVE, LOCALIZE = 1, 2, 4, 8, 16, 32
WORLD = PLACE | DRIVE | SENSE
STEP, BEGIN = DRIVE | SENSE | LOCALIZE | JUDGE | OBSERVE, PLACE | SENSE | LOCALIZE | OBSERVE
# Robots that go through each part together: the code of all parts is more than a core's first
# cache holds.
BLOCK = 16
# Above this number of its action a robot declares.
DECLARING = 0.5


@kernel(forceinline=True)
def move(walls, state, settings, people, boxes, i, speed, rate):
    """Drive robot i for a step, at most to where it collides; odometry reports its wheels."""
    table, bound = walls.table, walls.bound
    limits = (
        settings.max_speed, settings.max_turn_rate, settings.acceleration,
        settings.turn_acceleration,
    )  # fmt: skip
    speed, rate = limited(state.speeds[0], state.speeds[1], speed, rate, limits, settings.dt)
    state.speeds[0], state.speeds[1] = speed, rate
    x0, y0, t0 = state.truth[0], state.truth[1], state.truth[2]
    ground, turning = sample_ground(
        speed, rate, settings.dt, settings.true_odometry, state.random[MOTION_NOISE]
    )
    if settings.slip > 0.0 and near(state.truth, state.slippery, settings.slip_radius):
        # The wheels turn on as if there was grip.
        ground /= 1.0 + settings.slip
    state.ground[0], state.ground[1] = ground, turning
    length, ux, uy, bend = path(t0, ground, turning, settings.dt)
    share = free_share(x0, y0, ux, uy, bend, length, settings.radius, table, bound)
    if state.boxes > 0:
        share = min(
            share,
            free_share_of_boxes(
                x0, y0, ux, uy, bend, length, settings.radius, boxes, state.boxes, i
            ),
        )
    x1, y1, t1 = unicycle(x0, y0, t0, ground, turning, share * settings.dt)
    state.before[0], state.before[1], state.before[2] = x0, y0, t0
    state.driven, state.collided = length * share, share < 1.0
    state.truth[0], state.truth[1], state.truth[2] = x1, y1, t1
    before = state.odometry[0], state.odometry[1], state.odometry[2]
    after = unicycle(*before, speed, rate, share * settings.dt)
    state.odometry[0], state.odometry[1], state.odometry[2] = after
    if settings.localizer != MCL:
        propagate_covariance(
            state.mean, state.covariance, *before, *after, settings.modelled_odometry
        )
    if people.shape[1] > 0:
        walk(people, i, x1, y1, settings, table, bound, state.random[WALKERS])


@kernel(forceinline=True)
def localize(cast, noise, state, settings, readings, scratch):
    """Update a robot's localizer with its readings, if the localizer is a kernel."""
    if settings.localizer == EKF:
        update_pose(
            state.mean, state.covariance, readings, settings.gate, settings.rounds, False, cast,
            noise, scratch,
        )  # fmt: skip
    elif settings.localizer == PERFECT:
        for k in range(3):
            state.mean[k] = state.truth[k]
            for j in range(3):
                state.covariance[k, j] = 0.0


@kernel
def keep(state, late, i, steps):
    """Store a step's estimate in row i of `Memory.late`; fill all of it with the first one.

    Args:
        state: The robot's `STATE`.
        late: Written.
        i: Which robot.
        steps: Number of the step, 0 at the beginning.
    """
    held = late.shape[1]
    for slot in range(steps, steps + (held if steps == 0 else 1)):
        for k in range(3):
            late[i, slot % held].mean[k] = state.mean[k]
            for j in range(3):
                late[i, slot % held].covariance[k, j] = state.covariance[k, j]


@kernel
def carry(state):
    """Kidnap a robot: odometry, localizer and `progress` do not notice."""
    for k in range(3):
        state.truth[k] = state.kidnap_pose[k]
    state.distance = state.kidnap_cost


@kernel
def errors(state):
    """Return the errors of the estimate: metres and radians, both at least 0."""
    dx, dy = state.mean[0] - state.truth[0], state.mean[1] - state.truth[1]
    return math.sqrt(dx * dx + dy * dy), abs(wrapped(state.mean[2] - state.truth[2]))


@kernel(forceinline=True)
def judge(layers, goals, state, mean, cov, settings, i, figures):
    """Decide the outcome of robot i, and compute the reward of the step.

    Args:
        layers: See `MapLayers`.
        goals: See `GoalArrays`.
        state: Its `STATE`, written.
        mean: The estimate that has reached it, shape (3,).
        cov: Its covariance, shape (3, 3).
        settings: See `SETTINGS`.
        i: Which robot.
        figures: Row i is written, see `COLUMNS`.
    """
    off, turned = errors(state)
    far = off > LOST_POSITION or turned > LOST_HEADING
    state.far_steps = state.far_steps + 1 if far else 0
    # Counted from the first sample above the limit.
    state.lost = state.far_steps > settings.lost_steps + 1
    state.was_lost |= state.lost
    state.steps += 1
    # Along the chord, as `AmbiguityService.reward`: the arc of a step is hardly longer.
    x0, y0, t0 = state.before[0], state.before[1], state.before[2]
    x1, y1, t1 = state.truth[0], state.truth[1], state.truth[2]
    exposed = integral_straight(x0, y0, t0, x1, y1, t1, layers.level, *layers.frame)
    bound = integral_straight(x0, y0, t0, x1, y1, t1, layers.fisher, *layers.frame)
    state.exposure += exposed
    state.travelled += state.driven
    distance = state.distance
    now = distance_at(x1, y1, goals.costs[state.slot], goals.links, *goals.frame)
    # In a tight corner there may be no path from where a robot is: its distance stays as it was.
    if now < math.inf:
        state.distance = now
    state.outcome = outcome_of(state, mean, cov, settings)
    terms = Terms(
        progress=distance - settings.gamma * state.distance,
        arrival=1.0 if state.outcome == ARRIVED else 0.0,
        collision=-1.0 if state.collided else 0.0,
        missed=-1.0 if state.outcome == MISSED else 0.0,
        time=-settings.dt,
        ambiguity=0.0 - exposed,
        fisher=0.0 - bound,
        error=0.0 - off * state.driven,
        lost=-settings.dt if state.lost else 0.0,
        belief=settings.dt * state.belief,
    )
    total = 0.0
    for k in range(len(terms)):
        # A weight of 0 gives 0 and not -0.
        part = settings.weights[k] * terms[k] + 0.0
        figures[i, VALUES + k], figures[i, WEIGHTED + k] = terms[k], part
        total += part
    figures[i, REWARD] = total
    figures[i, COST_COLLISION] = 1.0 if state.collided else 0.0
    figures[i, COST_LOST] = 1.0 if state.lost else 0.0
    write_status(state, off, figures, i)


@kernel
def outcome_of(state, mean, cov, settings):
    """Return the outcome of a robot, one of `OUTCOMES` by code."""
    if state.collided:
        return COLLIDED
    stops = state.declared == DECLARED_ARRIVED
    if settings.arrived_column < 0:
        stops = near(mean, state.goal, settings.goal_radius) and sure(cov, settings.goal_std)
    if stops:
        return ARRIVED if near(state.truth, state.goal, settings.success_radius) else MISSED
    if settings.end_when_lost and state.lost:
        return LOST
    return TIMEOUT if state.steps >= settings.max_steps else RUNNING


@kernel
def sure(cov, most):
    """Return whether the position's standard deviation is at most this along every axis."""
    mean, half = 0.5 * (cov[0, 0] + cov[1, 1]), 0.5 * (cov[0, 0] - cov[1, 1])
    return mean + math.sqrt(half * half + cov[0, 1] * cov[0, 1]) <= most * most


@kernel
def near(pose, point, radius):
    """Return whether a pose is within a radius of a point."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    return dx * dx + dy * dy <= radius * radius


@kernel(forceinline=True)
def write_status(state, off, figures, i):
    """Write the figures that a reset also has; the costs are written already."""
    figures[i, COST] = figures[i, COST_COLLISION] + figures[i, COST_LOST]
    figures[i, ERROR] = off
    figures[i, EXPOSURE] = state.exposure
    figures[i, TRAVELLED] = state.travelled
    figures[i, SHORTEST] = state.shortest
    for k in range(3):
        figures[i, TRUE_POSE + k] = state.truth[k]
        figures[i, ESTIMATE + k] = state.mean[k]
        figures[i, ODOMETRY + k] = state.odometry[k]


@kernel
def declare(state, settings, actions, i):
    """Note what robot i declares; return whether it waits for help in this step.

    Who waits declares nothing, and who is there does not call for help.
    """
    state.declared, state.helped = 0, False
    columns = settings.arrived_column, settings.lost_column
    for k in range(2):
        says = columns[k] >= 0 and actions[i, columns[k]] > DECLARING
        state.claims[k] = state.claims[k] + 1 if says and state.waiting == 0 else 0
        if state.claims[k] >= settings.declare_steps and state.declared == 0:
            state.declared = k + 1
    if state.declared == DECLARED_LOST:
        state.claims[1], state.waiting = 0, settings.help_steps
    if state.waiting == 0:
        return False
    state.waiting -= 1
    state.helped = state.waiting == 0
    return True


@kernel
def give_pose(state, settings):
    """Give a robot an estimate of its pose, with the deviations `start_std`."""
    for k in range(3):
        std = settings.start_std[k]
        state.mean[k] = state.truth[k] + std * ziggurat(state.random[START])
        for j in range(3):
            state.covariance[k, j] = std * std if j == k else 0.0


@kernel(forceinline=True)
def act(walls, bounds, state, mean, settings, people, boxes, actions, i):
    """Drive robot i by its action, see `spaces.continuous`.

    What it believes is judged first: that is about the pose at which it has observed.
    """
    state.belief = 0.0
    if settings.belief_column >= 0:
        state.belief = score(actions, i, settings.belief_column, mean, state.truth, bounds)
    if state.kidnap_step > 0 and state.steps == state.kidnap_step:
        carry(state)
    waits = declare(state, settings, actions, i)
    least = settings.min_speed
    speed = least + 0.5 * (share_of(actions[i, 0]) + 1.0) * (settings.max_speed - least)
    rate = share_of(actions[i, 1]) * settings.max_turn_rate
    if settings.gain_std + settings.actuation_std > 0.0:
        random, std = state.random[START], settings.actuation_std
        speed *= max(state.gain[0] + std * ziggurat(random), 0.0)
        rate *= max(state.gain[1] + std * ziggurat(random), 0.0)
    if waits:
        speed = rate = 0.0
    move(walls, state, settings, people, boxes, i, speed, rate)
    if state.helped:
        give_pose(state, settings)


@kernel(forceinline=True)
def place(walls, bounds, state, settings, people, boxes, i):
    """Place boxes and people around robot i at `truth`; return whether there is room for them.

    Its localizer gets an initial estimate.
    """
    table = walls.table
    give_pose(state, settings)
    for k in range(2):
        state.gain[k] = 1.0 + settings.gain_std * ziggurat(state.random[START])
    x, y = state.truth[0], state.truth[1]
    later = x, y
    if state.kidnap_step > 0:
        later = state.kidnap_pose[0], state.kidnap_pose[1]
    state.boxes = clutter(
        boxes, i, state.boxes, x, y, state.goal[0], state.goal[1], *later, bounds, settings, table,
        state.random[CLUTTER],
    )  # fmt: skip
    return gather(people, i, x, y, bounds, settings, table, state.random[WALKERS])


# numba counts references to arrays wherever they are handed on: with `_nrt=False`, which leaves
# that out, 2048 robots make the same steps 1.5 times as fast. Nothing needs counting: who calls
# `advance` holds its arrays until it returns, and no array is made within, so the scratch comes
# from outside.
@kernel(_nrt=False)
def advance(building, goals, scanner, memory, view, figures, actions, rows, parts, scratch):
    """Step some robots, begin their episodes, or do a part of these.

    All of it is one kernel, so that what steps and beginnings share is compiled once.

    Args:
        building: The building that all of them are in, see `BuildingRecord`.
        goals: Costs to go in it, see `GoalArrays`.
        scanner: See `ScannerArrays`.
        memory: State of all N robots, see `Memory`.
        view: Rows `rows` are written, see `View`.
        figures: Rows `rows` are written, see `COLUMNS`.
        actions: Shape (N, columns), see `spaces.continuous`; read with `DRIVE` alone.
        rows: Which robots.
        parts: What of it, `STEP` or `BEGIN` or some of their bits.
        scratch: See `ambinav.localization.ekf_update.Scratch`; no two threads share one.

    Returns:
        The first robot without room for its people, with which the work ends; -1 for none.
    """
    cast, noise, walls, layers = building.cast, building.noise, building.walls, building.layers
    states, people, boxes, readings = memory.state, memory.people, memory.boxes, memory.readings
    settings, late, held = memory.settings[0], memory.late, memory.late.shape[1]
    for first in range(0, rows.size, BLOCK):
        block = rows[first : first + BLOCK]
        if parts & (PLACE | DRIVE):
            for k in range(block.size):
                i = block[k]
                if parts & PLACE and not place(
                    walls, building.bounds, states[i], settings, people, boxes, i
                ):
                    return i
                if parts & DRIVE:
                    state = states[i]
                    mean = state.mean
                    if held > 0:
                        mean = late[i, (state.steps + 1) % held].mean
                    act(walls, building.bounds, state, mean, settings, people, boxes, actions, i)
        if parts & SENSE:
            for k in range(block.size):
                i = block[k]
                sense(cast, scanner, states[i], settings, people, boxes, readings, i, scratch)
        if parts & LOCALIZE:
            for k in range(block.size):
                i = block[k]
                localize(cast, noise, states[i], settings, readings[i], scratch)
        if parts & (JUDGE | OBSERVE):
            for k in range(block.size):
                i = block[k]
                state = states[i]
                mean, cov = state.mean, state.covariance
                if held > 0:
                    steps = state.steps + (parts & JUDGE) // JUDGE
                    if parts & JUDGE or steps == 0:
                        keep(state, late, i, steps)
                    old = late[i, (steps + 1) % held]
                    mean, cov = old.mean, old.covariance
                if parts & JUDGE:
                    judge(layers, goals, state, mean, cov, settings, i, figures)
                elif parts & OBSERVE:
                    figures[i] = 0.0
                    write_status(state, errors(state)[0], figures, i)
                if parts & OBSERVE:
                    observe(
                        walls, layers, goals, scanner.far, state, mean, cov, settings, readings,
                        view, i,
                    )  # fmt: skip
    return -1
