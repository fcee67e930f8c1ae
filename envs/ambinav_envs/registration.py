"""The registry of tasks, and their ids for `gymnasium.make`; the modules are imported on use."""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium
from gymnasium.envs.registration import EnvSpec

from ambinav.config import nearest
from ambinav.plugins import Registry, load_module
from ambinav.runtime.errors import InputError, InputWarning
from ambinav_envs.task_spec import ID, TaskSpec
from ambinav_envs.tasks import HARD_TASKS, SHIPPED, TWIN_ROOMS
from ambinav_envs.twins import belief_ids_of, twins_of

NAVIGATION_ENV: Final = "ambinav_envs.navigation:NavigationEnv"
"""Entry point of the ids of all tasks."""

IDS: Final[dict[str, dict[str, Any]]] = {spec.name: dict(spec.arguments) for spec in SHIPPED}
"""Every shipped id, with its arguments.

Each has its twins beside it, see `twins.TWINS`; the first of them and the hard tasks also have a
`-Belief` id, see `twins.BELIEF`. Tasks of plug-ins are in `TASKS` alone.

A change of what an environment does is a new version. `Navigation-v1` takes `map=` or `suite=`;
discrete actions are the argument `discrete=True` of any of them. No id limits the episodes' steps:
the environment does so itself, by `max_steps`, truncates and says the limit in its own spec.
"""
IDS.update(
    twins_of(IDS)
    | belief_ids_of({spec.name: spec.arguments for spec in (SHIPPED[0], *HARD_TASKS, *TWIN_ROOMS)})
)


class TaskRegistry(Registry[TaskSpec]):
    """A `Registry` whose entries are ids of Gymnasium too."""

    def register(self, entry: TaskSpec) -> TaskSpec:
        """Add a task until the process ends, and register its id and its twins with Gymnasium.

        Raises:
            InputError: there is another one of that name, or Gymnasium has one of the ids already.
        """
        ids = _with_twins({entry.name: {"task": entry.name}}, self.names())
        for name, arguments in ids.items():
            _is_registered(name, arguments)
        super().register(entry)
        for name, arguments in ids.items():
            _register_id(name, arguments)
        return entry


def _itself(spec: TaskSpec) -> TaskSpec:
    return spec


TASKS: Final = TaskRegistry(
    "task", TaskSpec, "ambinav.tasks", {spec.name: partial(_itself, spec) for spec in SHIPPED}
)
"""The tasks: ours, and those of plug-ins."""


def register_envs() -> None:
    """Register all tasks and their twins with Gymnasium; existing registrations stay as they are.

    `import ambinav_envs` does this. Where nothing imports it, say so in the id:
    `gymnasium.make("ambinav_envs:ambinav/Office-v1")`.

    Warns:
        InputWarning: a plug-in has the name of another task, so that those of plug-ins are left
            out; or Gymnasium has an id already that stands for something else.
    """
    shipped = {spec.name for spec in SHIPPED}
    names: tuple[str, ...] = ()
    try:
        names = TASKS.names()
    except InputError as error:
        warnings.warn(f"tasks of plug-ins are left out: {error}", InputWarning, stacklevel=2)
    # A plug-in is loaded when its id is made: `scenario` then asks for the arguments.
    plugged = {name: {"task": name} for name in names if name not in shipped and ID.fullmatch(name)}
    for ids in (IDS, _with_twins(plugged, names)):
        for name, arguments in ids.items():
            try:
                _register_id(name, arguments)
            except InputError as error:
                warnings.warn(f"left out: {error}", InputWarning, stacklevel=2)


def _with_twins(
    ids: Mapping[str, Mapping[str, Any]], tasks: Collection[str]
) -> dict[str, Mapping[str, Any]]:
    """Return ids and their twins, except twins that have the name of a task."""
    twins = {name: twin for name, twin in twins_of(ids).items() if name not in tasks}
    return {**ids, **twins}


def _is_registered(name: str, arguments: Mapping[str, Any]) -> bool:
    """Return whether an id is registered already.

    Raises:
        InputError: it is, and stands for something else.
    """
    spec = gymnasium.registry.get(name)
    if spec is None or (is_plain(spec) and spec.kwargs == arguments):
        return spec is not None
    raise InputError(
        f"task {name!r}: Gymnasium has another environment of this id already; choose another name."
    )


def _register_id(name: str, arguments: Mapping[str, Any]) -> None:
    """Register an id with the arguments that it stands for.

    Raises:
        InputError: see `_is_registered`.
    """
    if not _is_registered(name, arguments):
        gymnasium.register(
            name,
            entry_point=NAVIGATION_ENV,
            vector_entry_point="ambinav_envs.vector:NavigationVectorEnv",
            kwargs=dict(arguments),
        )


def spec_of(name: object) -> EnvSpec:
    """Return what Gymnasium knows of an id, "module:id" included.

    Raises:
        InputError: nobody has registered it, and the nearest are offered; or its module cannot be
            imported.
    """
    module, colon, id_alone = str(name).rpartition(":")
    if colon:
        try:
            load_module(module, Path())
        except InputError as error:
            raise InputError(f"the id is {name!r}, but {error}.") from error
    if id_alone in gymnasium.registry:
        return gymnasium.registry[id_alone]
    candidates = []
    for env_id, spec in gymnasium.registry.items():
        # Gymnasium's own are no navigation environments; of some the entry point is a function.
        entry: object = spec.entry_point
        if not str(getattr(entry, "__module__", entry)).startswith("gymnasium."):
            candidates.append(env_id)
    raise InputError(f"the id is {name!r}; {nearest(id_alone, candidates)}.")


def without_own_module(name: str) -> str:
    """Return an id without the prefix "ambinav_envs:"; ids with other modules stay as they are."""
    return name.removeprefix("ambinav_envs:")


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
    fixed = dict(TASKS.get(task).arguments)
    replaced: tuple[str, ...] = ()
    if arguments.get("map") is not None:
        replaced = ("suite", "map", "buildings", "first_building")
    elif arguments.get("suite") is not None:
        replaced = ("suite", "map")
    remaining = {name: value for name, value in fixed.items() if name not in replaced}
    return remaining | dict(arguments)
