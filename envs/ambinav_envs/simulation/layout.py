"""Layout of the simulation's arrays: variable state of the robots and constant settings.

One record holds all of a robot's numbers, so that a step reads and writes one piece of memory and
no robot touches another's. Kernels take records apart by name, as Python does.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.array_types import Floats, Floats32

# Outcomes of an episode, by code.
RUNNING, ARRIVED, MISSED, COLLIDED, LOST, TIMEOUT = range(6)
OUTCOMES = ("running", "arrived", "missed", "collided", "lost", "timeout")
"""Names of the codes. Those before the last but "running" are ends of the task itself."""

EKF, PERFECT, ODOMETRY, MCL = range(4)
LOCALIZERS = ("ekf", "perfect", "odometry", "mcl")
"""Names of the localizers, by code."""

DECLARATIONS = ("arrived", "lost")
"""Declarations of a robot by number, from 1 on."""
DECLARED_ARRIVED, DECLARED_LOST = 1, 2
# The numbers of an action before its declarations: speed and turn rate.
MOTIONS = 2


class Terms(NamedTuple):
    """Built-in terms of the reward in a step; `step.judge` returns them, see `rewards`."""

    progress: float
    arrival: float
    collision: float
    missed: float
    time: float
    ambiguity: float
    fisher: float
    error: float
    lost: float
    belief: float


TERMS = Terms._fields
"""Their names, in the order in which arrays have them."""

# Columns of the table of figures that a step makes: the reward, its terms as they are and times
# their weights, other figures of a step, and three poses.
REWARD, VALUES, WEIGHTED, FIRST_FIGURE = 0, 1, 1 + len(TERMS), 1 + 2 * len(TERMS)
FIGURES = ("cost_collision", "cost_lost", "cost", "error", "exposure", "travelled", "shortest")
"""Names of the columns from `FIRST_FIGURE` on."""
TRUE_POSE = FIRST_FIGURE + len(FIGURES)
ESTIMATE, ODOMETRY, COLUMNS = TRUE_POSE + 3, TRUE_POSE + 6, TRUE_POSE + 9
COST_COLLISION, COST_LOST, COST, ERROR, EXPOSURE, TRAVELLED, SHORTEST = range(
    FIRST_FIGURE, TRUE_POSE
)

# The streams of random numbers of an episode; START is also for what the wheels do, and for the
# pose that a robot gets which calls for help.
BUILDING, TASK, START, PARTICLES, MOTION_NOISE, SCANNER, WALKERS, CLUTTER = range(8)
STREAMS = 8

_REAL, _WHOLE, _WORD = np.float64, np.int64, np.uint64


def record(**columns: object) -> np.dtype[np.void]:
    """Return the type of a record; each column is a type, or a type and a shape."""
    return np.dtype(
        [(name, *(kind if isinstance(kind, tuple) else (kind,))) for name, kind in columns.items()],
        align=True,
    )


NOISE = record(
    turn_turn=_REAL, turn_trans=_REAL, trans_trans=_REAL, trans_turn=_REAL, bias_distance=_REAL,
    bias_turn=_REAL,
)  # fmt: skip
"""`ambinav.drive.noise.PackedNoise`."""

STATE = record(
    truth=(_REAL, 3),
    speeds=(_REAL, 2),
    ground=(_REAL, 2),
    odometry=(_REAL, 3),
    mean=(_REAL, 3),
    covariance=(_REAL, (3, 3)),
    goal=(_REAL, 2),
    random=(_WORD, (STREAMS, 4)),
    slot=_WHOLE,
    steps=_WHOLE,
    outcome=_WHOLE,
    far_steps=_WHOLE,
    lost=np.bool_,
    was_lost=np.bool_,
    boxes=_WHOLE,
    door=np.bool_,
    distance=_REAL,
    shortest=_REAL,
    exposure=_REAL,
    travelled=_REAL,
    before=(_REAL, 3),
    driven=_REAL,
    collided=np.bool_,
    kidnap_step=_WHOLE,
    kidnap_pose=(_REAL, 3),
    kidnap_cost=_REAL,
    slippery=(_REAL, 2),
    gain=(_REAL, 2),
    belief=_REAL,
    claims=(_WHOLE, 2),
    declared=_WHOLE,
    waiting=_WHOLE,
    helped=np.bool_,
)
"""One robot in its episode.

truth, mean and goal are in the map frame (metres, radians), odometry is in the odometry frame;
speeds are those of the wheels, which odometry measures, ground those over the floor, metres and
radians per second. mean and covariance are the localizer's latest estimate,
which may reach the robot later (`Memory.late`). slot is that of the goal in
`cost_to_go.CostToGoTable`.
far_steps counts the steps since which the error has been too large, boxes the unmapped boxes around
the robot, door whether the first of them is a closed door. distance is the cost to go from the true
position (`Task.cost_to_go`), shortest the length of the shortest path at the start; exposure and
travelled are sums so far. before, driven and collided are of the last step: the true pose before
it, the distance driven, whether it touched anything. After kidnap_step steps (0: never) the robot
is carried to kidnap_pose, from where the cost to go is kidnap_cost; slippery is the middle of the
floor where its wheels slip. gain is what its speed and its turn rate are of what is commanded, on
the mean of the episode. belief is the score of what it has believed at the beginning of the last
step, nats, see `belief.score`. claims counts for how many steps it has said each of `DECLARATIONS`
without a break; declared is what it has declared in the last step, one of `DECLARATIONS`
from 1 on, or 0; waiting how many steps it still stands and waits for help, helped whether that came
in the last step.
"""

LATE = record(mean=(_REAL, 3), covariance=(_REAL, (3, 3)))
"""An estimate on its way to the robot, as in `STATE`."""

SETTINGS = record(
    dt=_REAL,
    radius=_REAL,
    min_speed=_REAL,
    max_speed=_REAL,
    max_turn_rate=_REAL,
    acceleration=_REAL,
    turn_acceleration=_REAL,
    true_odometry=NOISE,
    modelled_odometry=NOISE,
    localizer=_WHOLE,
    rounds=_WHOLE,
    gate=_REAL,
    start_std=(_REAL, 3),
    goal_radius=_REAL,
    success_radius=_REAL,
    goal_std=_REAL,
    slip=_REAL,
    slip_radius=_REAL,
    scan_time=_REAL,
    gain_std=_REAL,
    actuation_std=_REAL,
    lost_steps=_WHOLE,
    max_steps=_WHOLE,
    end_when_lost=np.bool_,
    gamma=_REAL,
    weights=(_REAL, len(TERMS)),
    arrived_column=_WHOLE,
    lost_column=_WHOLE,
    belief_column=_WHOLE,
    declare_steps=_WHOLE,
    help_steps=_WHOLE,
    person_radius=_REAL,
    person_speed=_REAL,
    window_cells=_WHOLE,
    window_spacing=_REAL,
    ambiguity_seen=np.bool_,
    waypoint=np.bool_,
    waypoint_distance=_REAL,
    obstacles=_WHOLE,
    box_least=_REAL,
    box_most=_REAL,
)
"""The same for all robots; units as in `NavigationParameters`."""


class Memory(NamedTuple):
    """All variable state of N robots, as the kernels take it.

    Attributes:
        state: `STATE`, shape (N,).
        people: x, y, heading of each person, shape (N, P, 3), metres and radians, map frame.
        boxes: Unmapped boxes, shape (N, Q, 6): x and y of the middle and of the vectors from there
            to the middles of two sides; rows from `state.boxes` on are not in use.
        readings: Readings of the scanner, shape (N, B), metres: inf no echo, -inf too near.
        late: The latest K + 1 estimates where the robot observes and stops by that of K steps ago,
            `LATE`, shape (N, K + 1): that of step s is at s modulo K + 1. Nothing where K is 0.
        settings: `SETTINGS`, shape (1,).
    """

    state: NDArray[np.void]
    people: Floats
    boxes: Floats
    readings: Floats
    late: NDArray[np.void]
    settings: NDArray[np.void]


class View(NamedTuple):
    """The parts of the observation of N robots, float32; see `ambinav_envs.spaces`."""

    scan: Floats32
    goal: Floats32
    velocity: Floats32
    uncertainty: Floats32
    window: Floats32
    waypoint: Floats32
    remaining: Floats32
    hypotheses: Floats32
