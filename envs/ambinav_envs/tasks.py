"""The tasks that are shipped, which are entries of `registration.TASKS`.

`HARD_TASKS` cannot be solved by following the route by the estimate. Each is the one environment
with other arguments; docs/tasks.md says of each what is asked and why a follower cannot do it,
benchmarks/results/tasks.md what those reach who have learnt nothing.
"""

from __future__ import annotations

import math
from typing import Any, Final

from ambinav_envs.rewards import PRESETS
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

_SURE_MCL: Final = {
    **GLOBAL_MCL, "recovery_alpha_slow": 0.0, "recovery_alpha_fast": 0.0,
    "importance_factor": 0.1, "min_particles": 1000, "max_particles": 1000, "update_min_a": 0.5,
}  # fmt: skip
"""Monte Carlo localization that keeps several hypotheses apart: with fewer particles or more weight
of a scan the shares of equal ones drift, and one of them dies without evidence."""
_THREE_WINGS: Final[dict[str, Any]] = {
    "suite": "triple-rooms", "start_prior": [0.4, 0.95], "max_steps": 1000,
    "reward": {**PRESETS["shortest"], "time": 0.005, "missed": 2.0},
}  # fmt: skip
"""A look at a chamber without the post leaves two wings: with the prices of two wings, looks cost
more time than false declarations cost."""
_LEVELS: Final[dict[str, dict[str, Any]]] = {
    "1-v2": {"suite": "twin-rooms-seen"},
    "2-v2": {"suite": "twin-rooms"},
    "3-v2": {"suite": "twin-rooms", "start_prior": [0.5, 0.95]},
    "4-v3": _THREE_WINGS,
    "5-v3": {**_THREE_WINGS, "people": 4},
}
_TWIN_ROOMS: Final[dict[str, dict[str, Any]]] = {
    f"TwinRooms{level}": {
        "localizer": "mcl", "mcl": _SURE_MCL, "start_aliases": 2, "hypotheses": 3,
        "shortest": 6.0, "longest": 25.0, "max_steps": 500,
        "reward": {**PRESETS["shortest"], "time": 0.01}, **own,
    }
    for level, own in _LEVELS.items()
}  # fmt: skip

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
    "TwinRooms1-v2": (
        "The wings of the building are equal but for a post in one chamber, and the localizer "
        "starts in as many places. The post is seen in passing."
    ),
    "TwinRooms2-v2": (
        "As the first level, but the post stands behind a passage of 1 to 6 m that is on no route: "
        "whoever does not look there guesses the wing, and half of the guesses are wrong."
    ),
    "TwinRooms3-v2": (
        "As the second level, but one of the wings is more likely from the start, by 50 to 95 %: a "
        "look costs time, and pays only when it is not likely enough."
    ),
    "TwinRooms4-v3": (
        "As the third level, with three wings: a look into one chamber may leave two of them. A "
        "false declaration costs twice what an arrival is worth, and time half of that in the "
        "other levels."
    ),
    "TwinRooms5-v3": ("As the fourth level, with four people who hide the post."),
}
"""Description of each task, and why a follower fails; the ids' pages begin with it."""


def _specs(tasks: dict[str, dict[str, Any]]) -> tuple[TaskSpec, ...]:
    return tuple(
        TaskSpec(
            name=f"{NAMESPACE}/{name}",
            about=_ABOUT[name],
            arguments={"buildings": VARIANTS, "declare": ["arrived"], **arguments},
        )
        for name, arguments in tasks.items()
    )


HARD_TASKS: Final = _specs(_ARGUMENTS)
"""Tasks that a follower cannot do. The robot declares its arrival, and the truth is the judge."""
TWIN_ROOMS: Final = _specs(_TWIN_ROOMS)
"""Tasks in which the localizer starts at several poses, in five levels; likewise declared."""
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
    *TWIN_ROOMS,
)
"""Every task that is shipped."""
