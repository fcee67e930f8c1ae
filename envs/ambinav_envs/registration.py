"""The registry of tasks, and their ids for `gymnasium.make`; the modules are imported on use."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium
from gymnasium.envs.registration import EnvSpec

from ambinav.config import nearest
from ambinav.plugins import Registry, load_module
from ambinav.runtime.errors import InputError
from ambinav_envs.task_spec import ID, TaskSpec
from ambinav_envs.tasks import SHIPPED
from ambinav_envs.twins import twins_of

NAVIGATION_ENV: Final = "ambinav_envs.navigation:NavigationEnv"
"""Entry point of the ids of all tasks."""

IDS: Final[dict[str, dict[str, Any]]] = {spec.name: dict(spec.arguments) for spec in SHIPPED}
"""Every shipped id, with its arguments.

Each has its twins beside it, see `twins.TWINS`. Tasks of plug-ins are in `TASKS` alone.

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
halves. Tasks have none: no policy that was trained for them is shipped."""


class TaskRegistry(Registry[TaskSpec]):
    """A `Registry` whose entries are ids of Gymnasium too."""

    def register(self, entry: TaskSpec) -> TaskSpec:
        """Add a task until the process ends, and register its id and its twins with Gymnasium.

        Raises:
            InputError: there is another one of that name.
        """
        super().register(entry)
        _register_ids({entry.name: {"task": entry.name}})
        return entry


def _own(spec: TaskSpec) -> TaskSpec:
    return spec


TASKS: Final = TaskRegistry(
    "task", TaskSpec, "ambinav.tasks", {spec.name: partial(_own, spec) for spec in SHIPPED}
)
"""The tasks: ours, and those of plug-ins."""


def register_envs() -> None:
    """Register all tasks and their twins with Gymnasium; existing registrations stay as they are.

    `import ambinav_envs` does this. Where nothing imports it, say so in the id:
    `gymnasium.make("ambinav_envs:ambinav/Office-v0")`.
    """
    _register_ids(
        # A plug-in is loaded when its id is made: `scenario` then asks for the arguments.
        {name: IDS.get(name, {"task": name}) for name in TASKS.names() if ID.fullmatch(name)}
    )


def _register_ids(ids: Mapping[str, Mapping[str, Any]]) -> None:
    """Register ids with the arguments that they stand for, and their twins."""
    for name, arguments in {**ids, **twins_of(ids)}.items():
        if name not in gymnasium.registry:
            namespace, _, own = name.partition("/")
            threshold = REWARD_THRESHOLDS.get(own.partition("-")[0])
            gymnasium.register(
                name,
                entry_point=NAVIGATION_ENV,
                vector_entry_point="ambinav_envs.vector:NavigationVectorEnv",
                kwargs=dict(arguments),
                reward_threshold=threshold if namespace == "ambinav" else None,
            )


def spec_of(name: object) -> EnvSpec:
    """Return what Gymnasium knows of an id, "module:id" included.

    Raises:
        InputError: nobody has registered it, and the nearest are offered; or its module cannot be
            imported.
    """
    module, colon, own = str(name).rpartition(":")
    if colon:
        try:
            load_module(module, Path())
        except InputError as error:
            raise InputError(f"the id is {name!r}, but {error}.") from error
    if own in gymnasium.registry:
        return gymnasium.registry[own]
    known = [
        other
        for other, spec in gymnasium.registry.items()
        if not str(spec.entry_point).startswith("gymnasium.")
    ]
    raise InputError(f"the id is {name!r}; {nearest(own, known)}.")


def is_plain(spec: EnvSpec) -> bool:
    """Return whether an id is our environment with arguments, and nothing around it."""
    entry: object = spec.entry_point
    if isinstance(entry, type):
        entry = f"{entry.__module__}:{entry.__qualname__}"
    return entry == NAVIGATION_ENV and not spec.additional_wrappers


def with_task(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return arguments of `NavigationEnv` with those of their `task`, which they replace.

    Raises:
        InputError: there is no such task.
    """
    task = arguments.get("task")
    if task is None:
        return dict(arguments)
    if not isinstance(task, str):
        raise InputError(f"task is {task!r}; give the name of a task.")
    own = dict(TASKS.get(task).arguments)
    replaced: tuple[str, ...] = ()
    if arguments.get("map") is not None:
        replaced = ("suite", "map", "buildings", "first_building")
    elif arguments.get("suite") is not None:
        replaced = ("suite", "map")
    return {name: value for name, value in own.items() if name not in replaced} | dict(arguments)
