"""A leaderboard: every method in every setting, and the results."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from gymnasium.envs.registration import load_env_creator

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.layers.registry import on_request
from ambinav.maps.content_digest import environment_digest
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.progress import Progress, Stages
from ambinav_envs.arena import Arena
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.buildings.suites import CONDITIONS as CONDITIONS
from ambinav_envs.buildings.suites import MIX, STANDARD, Suite, suite
from ambinav_envs.evaluation import UNSEEN, Episodes
from ambinav_envs.leaderboard.methods import SHORTEST, Method, RouteFollower
from ambinav_envs.leaderboard.store import code_of, key_of, load_episodes, save_episodes
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.fit import check_fit
from ambinav_envs.policies.policy import BUILDINGS, SEEING, Policy
from ambinav_envs.registered import arguments_of_id, is_wrapped
from ambinav_envs.registration import TASKS, spec_of
from ambinav_envs.scenario import source_of
from ambinav_envs.spaces import action_space, observation_space

BASELINE: Final = SHORTEST
"""The method that all others are compared with."""

FIXED: Final = frozenset((*BUILDINGS, *SEEING, "observations", "scanner", "robot", "layer", "task"))
"""Arguments that no condition changes: the maps of a venue and what a method sees depend on them,
and all conditions have these in common."""


@dataclass(frozen=True, eq=False)
class Venue:
    """A suite of buildings, a map or a task, where episodes are driven.

    Attributes:
        name: Name of the suite, the map or the task.
        what: Name of a suite, or an environment.
        count: How many buildings of the suite; None for a map.
        arguments: Arguments of a task's environment, except its buildings.
        wrapped: The task's id if somebody wrapped its environment, see `Arena`.
        first: Number of the first of the suite's buildings.
    """

    name: str
    what: str | Environment
    count: int | None
    arguments: Mapping[str, Any] = field(default_factory=dict)
    wrapped: str | None = None
    first: int = UNSEEN

    @property
    def identity(self) -> dict[str, Any]:
        """Plain values that identify it."""
        identity: dict[str, Any] = {"suite": self.what, "count": self.count, "first": self.first}
        if isinstance(self.what, Environment):
            identity = {"environment": environment_digest(self.what)}
        code = {"code": code_of(*self._functions())}
        return identity | code | ({} if self.wrapped is None else {"wrapped": self.wrapped})

    def _functions(self) -> Iterator[Callable[..., Any]]:
        """Yield what draws and judges episodes here."""
        if not isinstance(self.what, Environment):
            yield from suite(self.what).functions()
        task = self.arguments.get("task")
        if task is not None:
            spec = TASKS.get(task)
            yield from (function for function in (spec.draw, spec.judge) if function is not None)
        if self.wrapped is not None:
            entry: Any = spec_of(self.wrapped).entry_point
            yield load_env_creator(entry) if isinstance(entry, str) else entry


@dataclass(frozen=True, eq=False)
class Setting:
    """A venue under a condition.

    Attributes:
        name: In tables.
        place: The venue.
        condition: Name of the condition.
        arguments: Arguments of the environment there; None: those of that name in `CONDITIONS`.
    """

    name: str
    place: Venue
    condition: str
    arguments: Mapping[str, Any] | None = None

    @property
    def changed(self) -> Mapping[str, Any]:
        """Arguments of the environment under the condition."""
        return CONDITIONS[self.condition] if self.arguments is None else self.arguments


@dataclass(frozen=True, eq=False)
class Board:
    """Configuration of a leaderboard.

    Attributes:
        methods: The methods that take part.
        settings: Venues and conditions.
        episodes: Number of episodes of each method in each setting.
        seed: Seed of the episodes, from 0 on.
        options: Arguments of the environment that all have in common, also in the place of what
            a condition says.
        force: Let policies drive another scanner or robot than they were trained with.
        differs: How scanner and robot differ then, by the policy's name, see
            `policies.fit.differences`; `fitting` finds out.
    """

    methods: Sequence[Method]
    settings: Sequence[Setting]
    episodes: int
    seed: int
    options: Mapping[str, Any] = field(default_factory=dict)
    force: bool = False
    differs: Mapping[str, Mapping[str, Sequence[str]]] = field(default_factory=dict)

    @property
    def conditions(self) -> dict[str, dict[str, Any]]:
        """Arguments of the environment under each condition, by its name."""
        return {setting.condition: dict(setting.changed) for setting in self.settings}

    def changed(self, setting: Setting, method: Method) -> dict[str, Any]:
        """Return the arguments of a method in a setting beside those of the venue."""
        return {**setting.changed, **self.options, **method.seeing}

    def parameters(self, setting: Setting, method: Method) -> NavigationParameters:
        """Return the parameters of the environment in which a method drives.

        Raises:
            InputError: an option is unknown or of no use.
        """
        return NavigationParameters.of({**setting.place.arguments, **self.changed(setting, method)})

    def key(self, setting: Setting, method: Method) -> str:
        """Return a short hash of everything that the episodes of a method depend on."""
        return key_of(
            {
                "parameters": repr(self.parameters(setting, method)),
                "place": setting.place.identity,
                "episodes": self.episodes,
                "seed": self.seed,
                "method": method.identity,
            }
        )


def settings_for(
    maps: Sequence[Path],
    buildings: int,
    suites: Sequence[str] = (),
    tasks: Sequence[str] = (),
    **reading: Any,
) -> list[Setting]:
    """Return every venue under every condition.

    Args:
        maps: Environment files.
        buildings: How many of each suite.
        suites: Names of suites; none, and no task: `STANDARD`.
        tasks: Ids of tasks, or of environments that somebody wrapped.
        reading: How the environment files are read, as in `load_environment`.

    Raises:
        InputError: there is no such suite or task, a map cannot be read, or two have the same name.
    """
    settings = []
    for entry in chosen_suites(suites, tasks):
        for name in entry.members if MIX not in entry.name and entry.members else (entry.name,):
            settings += _conditions(Venue(name, name, buildings), entry.conditions)
    for name in tasks:
        settings += _conditions(venue_of_task(name, buildings), CONDITIONS)
    for path in maps:
        environment = load_environment(path, **reading)
        settings += _conditions(Venue(environment.name, environment, None), CONDITIONS)
    names = [setting.name for setting in settings]
    for setting in settings:
        if names.count(setting.name) > 1:
            raise InputError(
                f"two places are called {setting.place.name!r}, of maps, tasks and suites, some of "
                "which are driven by default; give each once, or rename a map's file."
            )
    for name, arguments in ((setting.condition, setting.changed) for setting in settings):
        if any(s.changed != arguments for s in settings if s.condition == name):
            raise InputError(
                f"two conditions are called {name!r} and are not the same; give one suite alone."
            )
    return settings


def chosen_suites(suites: Sequence[str], tasks: Sequence[str] = ()) -> list[Suite]:
    """Return the suites of a leaderboard.

    Args:
        suites: See `settings_for`.
        tasks: See there.

    Raises:
        InputError: there is no such suite.
    """
    return [suite(name) for name in suites or (() if tasks else (STANDARD,))]


def _conditions(place: Venue, conditions: Mapping[str, Mapping[str, Any]]) -> list[Setting]:
    return [
        Setting(f"{place.name}, {condition}", place, condition, arguments)
        for condition, arguments in conditions.items()
    ]


def venue_of_task(name: str, buildings: int) -> Venue:
    """Return the venue of an id.

    Raises:
        InputError: nobody has registered it, or it has buildings only if it is given some.
    """
    arguments = arguments_of_id(name)
    options = {key: value for key, value in arguments.items() if key not in BUILDINGS}
    source, _ = source_of(arguments)
    place: str | Environment = source.name if source.environment is None else source.environment
    count = buildings if source.environment is None else None
    return Venue(name, place, count, options, name if is_wrapped(name) else None)


def fitting(board: Board) -> Board:
    """Return the leaderboard without the baselines that do not fit; report each of them.

    A policy fits if it takes what it is shown, and scanner and robot are those that it was trained
    with or `force` is set.

    Raises:
        InputError: a policy that was asked for does not fit, or an option or a condition is of no
            use.
    """
    # Venues without arguments of their own are alike.
    settings = {repr(dict(s.place.arguments)): s for s in reversed(board.settings)}.values()
    for setting in board.settings:
        _check_condition(board, setting, board.methods[0])
    methods, differs = [], {}
    for method in board.methods:
        try:
            differences: dict[str, tuple[str, ...]] = {}
            for setting in board.settings:
                _check_condition(board, setting, method)
            for setting in settings:
                differences |= _check(board, setting, method)
        except InputError as error:
            if not method.shipped:
                raise
            warnings.warn(f"left out: {error}", InputWarning, stacklevel=2)
        else:
            methods.append(method)
            if differences:
                differs[method.name] = differences
    return replace(board, methods=methods, differs=differs)


def _check_condition(board: Board, setting: Setting, method: Method) -> None:
    """Check before the long computation that an environment has a condition's arguments.

    Raises:
        InputError: the condition changes what all have in common, or an argument is of no use.
    """
    where = f"suite {setting.place.name!r}, condition {setting.condition!r}"
    for key in setting.changed:
        if key in FIXED:
            raise InputError(
                f"{where}: {key} is given, but buildings, scanner, robot, layer, task, "
                "observations and actions are the same in all conditions; leave it out, or give it "
                "to the whole leaderboard."
            )
    try:
        board.parameters(setting, method)
    except InputError as error:
        if not setting.changed:
            raise
        raise InputError(f"{where}: {error}") from error


def _check(board: Board, setting: Setting, method: Method) -> dict[str, tuple[str, ...]]:
    """Check before the long computation whether a method fits, and what differs if it is forced."""
    parameters = board.parameters(setting, method)
    driver = method.make(parameters)
    if not isinstance(driver, Policy):
        return {}
    layer = driver.environment.get("layer") or parameters.cost_layer
    if layer != parameters.cost_layer:
        raise InputError(
            f"policy {method.name!r} was trained to see the layer {layer!r}, and all others see "
            f"{parameters.cost_layer!r}; give layer={layer}, or leave it out."
        )
    driver.configure(parameters)
    driver.prepare(observation_space(parameters), action_space(parameters))
    return check_fit(driver, parameters, board.force)


def run(board: Board, work: Path, begin: Stages) -> dict[str, dict[str, Episodes]]:
    """Run the episodes that have not been run yet.

    Args:
        board: The leaderboard.
        work: Folder with a file for each method and setting, and the routes of each planner.
        begin: Given a text, returns what takes the share done.

    Returns:
        Episodes by setting and method.

    Raises:
        InputError: a building has no room for the robot or a task, or a policy fails.
    """
    results: dict[str, dict[str, Episodes]] = {setting.name: {} for setting in board.settings}
    sources: dict[str, BuildingSource] = {}
    for method in board.methods:
        for setting in board.settings:
            path = work / f"{board.key(setting, method)}.npz"
            episodes = load_episodes(path)
            if episodes is None:
                source = source_for(board, setting, sources)
                bar = begin(f"{method.name}: {setting.name}")
                episodes = _drive(board, setting, method, source, work, bar)
                save_episodes(episodes, path)
                bar(1.0)
            results[setting.name][method.name] = episodes
    return results


def source_for(
    board: Board, setting: Setting, sources: dict[str, BuildingSource]
) -> BuildingSource:
    """Return the building source of a setting; it is shared, because it holds the maps."""
    place = setting.place
    if place.name not in sources:
        parameters = NavigationParameters.of({**place.arguments, **board.options})
        first, size = (0, 1) if place.count is None else (place.first, place.count)
        sources[place.name] = BuildingSource(
            place.what, parameters.scanner, parameters.robot.radius, count=place.count,
            first=first, held=size, layers=on_request(parameters.cost_layer),
        )  # fmt: skip
    return sources[place.name]


def _drive(
    board: Board,
    setting: Setting,
    method: Method,
    source: BuildingSource,
    work: Path,
    progress: Progress,
) -> Episodes:
    """Run all episodes of a method in a setting; routes are reused across conditions."""
    parameters = board.parameters(setting, method)
    driver: Any = method.make(parameters)
    routes = None
    if isinstance(driver, RouteFollower):
        identity: dict[str, Any] = {"method": method.identity, "place": setting.place.identity}
        identity |= {"scanner": parameters.scanner.to_yaml(), "robot": repr(parameters.robot)}
        identity |= {"layer": parameters.cost_layer, "odometry": repr(parameters.odometry)}
        identity |= {"start_std": list(parameters.start_std)}
        routes = work / f"routes-{key_of(identity)}.npz"
        driver.routes.load(routes)
    arena = Arena(source, parameters)
    if setting.place.wrapped is not None:
        arena = _wrapped_arena(setting.place, board.changed(setting, method), arena)
    try:
        return arena.evaluate(driver, board.episodes, board.seed, progress)
    finally:
        if routes is not None:
            driver.routes.save(routes)


def _wrapped_arena(place: Venue, changed: Mapping[str, Any], arena: Arena) -> Arena:
    """Return the arena of an environment that somebody wrapped, made with no more than it needs."""
    arguments = {key: value for key, value in changed.items() if place.arguments.get(key) != value}
    if place.count is not None:
        arguments |= {"buildings": place.count, "first_building": place.first}
    return replace(arena, wrapped=place.wrapped, arguments=arguments)
