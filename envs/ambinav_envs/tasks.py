"""The tasks that are shipped, which are entries of `registration.TASKS`.

`HARD_TASKS` cannot be solved by following the route by the estimate. Each is the one environment
with other arguments; docs/tasks.md says of each what is asked and why a follower cannot do it,
benchmarks/results/tasks.md what those reach who have learnt nothing.
"""

from __future__ import annotations

import math
from typing import Any, Final

from ambinav_envs.task_spec import TaskSpec

NAMESPACE: Final = "ambinav"
SUITES_WITH_IDS: Final = ("hall", "corridor", "office", "warehouse", "loop", "procedural")
"""The suites of buildings that have ids of their own."""
VARIANTS: Final = 64
"""A suite's id draws from so many buildings; their maps are made once, a tenth of a second each."""

GLOBAL_MCL: Final[dict[str, Any]] = {
    "laser_model_type": "likelihood_field_prob",
    "importance_factor": 0.3,
    "sigma_hit": 0.1,
    "max_beams": 30,
    "min_particles": 200,
    "max_particles": 1000,
    "recovery_alpha_slow": 0.001,
    "recovery_alpha_fast": 0.1,
}
"""Monte Carlo localization that finds itself again: it multiplies the beams, and puts particles
anywhere when the scan no longer fits."""

_ARGUMENTS: Final[dict[str, dict[str, Any]]] = {
    "Kidnapped-v1": {
        "suite": "procedural", "localizer": "mcl", "mcl": GLOBAL_MCL, "kidnapped": 1.0,
        "shortest": 8.0, "longest": 20.0, "max_steps": 500,
    },
    "UnknownStart-v1": {
        "suite": "warehouse", "localizer": "mcl", "mcl": GLOBAL_MCL, "start_unknown": True,
        "goal_std": 0.3, "shortest": 5.0, "longest": 15.0, "max_steps": 500,
    },
    "NarrowScanner-v1": {
        "suite": "hall", "scanner": {"beams": 30, "aperture": math.pi / 2.0},
        "odometry_scale": 2.0, "shortest": 4.0, "longest": 15.0, "max_steps": 400,
    },
    "AccurateGoal-v1": {
        "suite": "hall", "goal_radius": 0.1, "success_radius": 0.12, "odometry_scale": 2.0,
        "shortest": 4.0, "longest": 15.0, "max_steps": 400,
    },
    "LandmarkDetour-v1": {
        "suite": "hall", "goal_std": 0.1, "odometry_scale": 3.0, "shortest": 8.0, "longest": 20.0,
        "max_steps": 225,
    },
}  # fmt: skip
"""Arguments beside the number of buildings and what is declared, by name."""

_ABOUT: Final[dict[str, str]] = {
    "Kidnapped-v1": (
        "The robot is carried elsewhere between 3 and 12 seconds after its start, and nobody "
        "tells its odometry or its localizer. A follower goes on along a route that leads from "
        "where the robot is not: the waypoint, the window and the goal are all seen from the "
        "wrong pose until the particles have found the right one, and what it drives meanwhile "
        "decides how soon that is."
    ),
    "UnknownStart-v1": (
        "The particles are spread over the whole building, in rows of racks that look alike. A "
        "follower drives to the waypoint of a guess; what has to be found is a place that tells "
        "the rows apart, before the robot says that it has arrived."
    ),
    "NarrowScanner-v1": (
        "The scanner looks 90 degrees ahead, and odometry errs twice as much as modelled. A "
        "follower looks where it drives, in a hall mostly at nothing; the robot has to be "
        "turned towards a wall in time."
    ),
    "AccurateGoal-v1": (
        "The robot has to be within 0.12 m of the goal when it says that it is there, in a hall, "
        "with odometry twice as bad as modelled. A follower comes with whatever error the last "
        "bare stretch has left; the last leg has to begin at something to see."
    ),
    "LandmarkDetour-v1": (
        "Time against certainty: the robot has 45 s to be at its goal and to say so, in a hall, "
        "with odometry three times as bad as modelled. A follower comes to the goal unsure, and "
        "stands there until time is over, or says so and is wrong. A detour past walls and "
        "pillars makes it sure, and takes time: which one still pays has to be decided on the way."
    ),
}
"""Description of each task, and why a follower fails; the ids' pages begin with it."""

HARD_TASKS: Final = tuple(
    TaskSpec(
        name=f"{NAMESPACE}/{name}",
        about=_ABOUT[name],
        arguments={"buildings": VARIANTS, "declare": ["arrived"], **arguments},
    )
    for name, arguments in _ARGUMENTS.items()
)
"""Tasks that a follower cannot do. The robot declares its arrival, and the truth is the judge."""
SHIPPED: Final = (
    TaskSpec(
        name=f"{NAMESPACE}/Navigation-v1",
        about="Drive to a goal, in any map or suite of buildings.",
    ),
    *(
        TaskSpec(
            name=f"{NAMESPACE}/{name.capitalize()}-v1",
            about=f"Drive to a goal, in buildings of the suite {name}.",
            arguments={"suite": name, "buildings": VARIANTS},
        )
        for name in SUITES_WITH_IDS
    ),
    *HARD_TASKS,
)
"""Every task that is shipped."""
