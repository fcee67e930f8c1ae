"""Ids of the environments for `gymnasium.make`; the modules are imported on use."""

from __future__ import annotations

from typing import Any, Final

import gymnasium

from ambinav_envs.tasks import TASKS
from ambinav_envs.twins import twins_of

NAMESPACE: Final = "ambinav"
SUITES: Final = ("hall", "corridor", "office", "warehouse", "loop", "procedural")
"""The suites of buildings that have ids of their own."""
VARIANTS: Final = 64
"""Number of buildings of a suite's id; their maps are made once, in a tenth of a second each."""

IDS: Final[dict[str, dict[str, Any]]] = {
    f"{NAMESPACE}/Navigation-v0": {},
    **{
        f"{NAMESPACE}/{name.capitalize()}-v0": {"suite": name, "buildings": VARIANTS}
        for name in SUITES
    },
    **{
        f"{NAMESPACE}/{name}": {"buildings": VARIANTS, **arguments}
        for name, arguments in TASKS.items()
    },
}
"""Every id, with its arguments.

Each has its twins beside it, see `twins.TWINS`.

A change of what an environment does is a new version. `Navigation-v0` takes `map=` or `suite=`;
discrete actions are the argument `discrete=True` of any of them. No id limits the episodes' steps:
the environment does so itself, by `max_steps`, truncates and says the limit in its own spec.
"""
IDS.update(twins_of(IDS))

REWARD_THRESHOLDS: Final = {
    "Navigation": 15.0,
    "Hall": 9.0,
    "Corridor": 14.0,
    "Office": 15.0,
    "Warehouse": 15.0,
    "Loop": 14.0,
    "Procedural": 15.0,
}
"""Mean return of an episode from which an id counts as solved, with its default arguments: what the
shipped `ppo-shortest` gets in 200 episodes of 40 buildings that it has not seen, rounded down to
halves. Tasks have
none: no policy that was trained for them is shipped."""


def register_envs() -> None:
    """Register all `IDS` with Gymnasium; existing registrations stay as they are.

    `import ambinav_envs` does this. Where nothing imports it, say so in the id:
    `gymnasium.make("ambinav_envs:ambinav/Office-v0")`.
    """
    for name, arguments in IDS.items():
        if name not in gymnasium.registry:
            gymnasium.register(
                name,
                entry_point="ambinav_envs.navigation:NavigationEnv",
                vector_entry_point="ambinav_envs.vector:NavigationVectorEnv",
                kwargs=dict(arguments),
                reward_threshold=REWARD_THRESHOLDS.get(name.partition("/")[2].partition("-")[0]),
            )
