"""Ids of the environments for `gymnasium.make`, as strings: what they name is imported on use."""

from __future__ import annotations

from typing import Any, Final

import gymnasium

NAMESPACE: Final = "ambinav"
SUITES: Final = ("hall", "corridor", "office", "warehouse", "loop", "procedural")
"""The suites of buildings that have ids of their own."""
VARIANTS: Final = 64
"""A suite's id draws from so many buildings; their maps are made once, a tenth of a second each."""

IDS: Final[dict[str, dict[str, Any]]] = {
    f"{NAMESPACE}/Navigation-v0": {},
    **{
        f"{NAMESPACE}/{name.capitalize()}-v0": {"suite": name, "buildings": VARIANTS}
        for name in SUITES
        if name != "procedural"
    },
    f"{NAMESPACE}/Procedural-v0": {"suite": "procedural"},
}
"""Every id, with the arguments that it stands for; `Procedural-v0` has a new building each episode.

A change of what an environment does is a new version. `Navigation-v0` takes `map=` or `suite=`;
discrete actions are the argument `discrete=True` of any of them. No id limits the episodes' steps:
the environment does so itself, by `max_steps`, and truncates.
"""


def register_envs() -> None:
    """Make all `IDS` known to Gymnasium; those that are known are left as they are.

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
            )
