"""A leaderboard: every method in every setting, and the results."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.layers.registry import on_request
from ambinav.maps.content_digest import environment_digest
from ambinav.runtime.errors import InputError, InputWarning
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.buildings.suites import suite
from ambinav_envs.evaluation import UNSEEN, Episodes, evaluate
from ambinav_envs.leaderboard.methods import SHORTEST, Method, RouteFollower
from ambinav_envs.leaderboard.store import key_of, load_episodes, save_episodes
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.fit import check_fit
from ambinav_envs.policies.policy import Policy
from ambinav_envs.spaces import action_space, observation_space

SUITES: Final = ("procedural", "hall")
"""Unless others are named. In halls a path around the open middle is what helps."""
BASELINE: Final = SHORTEST
"""The method that all others are compared with."""

CONDITIONS: Final[Mapping[str, Mapping[str, Any]]] = {
    "as mapped": {},
    "disturbed": {"obstacles": 6, "people": 3, "odometry_scale": 2.0},
}
"""Arguments of the environment beside the common ones. Disturbed: boxes that the map lacks, people
who walk about, and odometry that errs twice as much as the localizer assumes."""

Bars = Callable[[str], Callable[[float], None]]


@dataclass(frozen=True, eq=False)
class Venue:
    """A suite of buildings or a map where episodes are driven.

    Attributes:
        name: Name of the suite or the map.
        what: Name of a suite, or an environment.
        count: How many buildings of the suite; None for a map.
    """

    name: str
    what: str | Environment
    count: int | None

    @property
    def identity(self) -> dict[str, Any]:
        """Plain values that identify it."""
        if isinstance(self.what, Environment):
            return {"environment": environment_digest(self.what)}
        return {"suite": self.what, "count": self.count, "first": UNSEEN}


@dataclass(frozen=True, eq=False)
class Setting:
    """A venue under a condition.

    Attributes:
        name: In tables.
        place: The venue.
        condition: Which of `CONDITIONS`.
    """

    name: str
    place: Venue
    condition: str


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

    def parameters(self, setting: Setting, method: Method) -> NavigationParameters:
        """Return the parameters of the environment in which a method drives.

        Raises:
            InputError: an option is unknown or of no use.
        """
        arguments = {**CONDITIONS[setting.condition], **self.options, **method.seeing}
        return NavigationParameters.of(arguments)

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
    **reading: Any,
) -> list[Setting]:
    """Return every venue under every condition.

    Args:
        maps: Environment files.
        buildings: How many of each suite.
        suites: Names of suites; none: `SUITES`.
        reading: How the environment files are read, as in `load_environment`.

    Raises:
        InputError: there is no such suite, a map cannot be read, or two have the same name.
    """
    places = [Venue(suite(name).name, name, buildings) for name in suites or SUITES]
    for path in maps:
        environment = load_environment(path, **reading)
        places.append(Venue(environment.name, environment, None))
    names = [place.name for place in places]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"two places are called {name!r}; give it once, or rename a file.")
    return [
        Setting(f"{place.name}, {condition}", place, condition)
        for place in places
        for condition in CONDITIONS
    ]


def fitting(board: Board) -> Board:
    """Return the leaderboard without the shipped policies that do not fit; report each of them.

    A policy fits if it takes what it is shown, and scanner and robot are those that it was trained
    with or `force` is set.

    Raises:
        InputError: a policy that was asked for does not fit, or an option is of no use.
    """
    board.parameters(board.settings[0], board.methods[0])
    methods, differs = [], {}
    for method in board.methods:
        try:
            differences = _check(board, method)
        except InputError as error:
            if not method.shipped:
                raise
            warnings.warn(f"left out: {error}", InputWarning, stacklevel=2)
        else:
            methods.append(method)
            if differences:
                differs[method.name] = differences
    return replace(board, methods=methods, differs=differs)


def _check(board: Board, method: Method) -> dict[str, tuple[str, ...]]:
    """Check before the long computation whether a method fits, and what differs if it is forced."""
    parameters = board.parameters(board.settings[0], method)
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


def run(board: Board, work: Path, begin: Bars) -> dict[str, dict[str, Episodes]]:
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
        driver = None
        for setting in board.settings:
            path = work / f"{board.key(setting, method)}.npz"
            episodes = load_episodes(path)
            if episodes is None:
                if driver is None:
                    # Conditions do not affect it.
                    driver = method.make(board.parameters(setting, method))
                source = _source(board, setting, sources)
                bar = begin(f"{method.name}: {setting.name}")
                episodes = _drive(board, setting, method, driver, source, work, bar)
                save_episodes(episodes, path)
                bar(1.0)
            results[setting.name][method.name] = episodes
    return results


def _source(board: Board, setting: Setting, sources: dict[str, BuildingSource]) -> BuildingSource:
    """Return the building source of a setting; it is shared, because it holds the maps."""
    place = setting.place
    if place.name not in sources:
        parameters = NavigationParameters.of(board.options)
        first, held = (0, 1) if place.count is None else (UNSEEN, place.count)
        sources[place.name] = BuildingSource(
            place.what, parameters.scanner, parameters.robot.radius, count=place.count,
            first=first, held=held, layers=on_request(parameters.cost_layer),
        )  # fmt: skip
    return sources[place.name]


def _drive(
    board: Board,
    setting: Setting,
    method: Method,
    driver: Any,
    source: BuildingSource,
    work: Path,
    progress: Callable[[float], None],
) -> Episodes:
    """Run all episodes of a method in a setting; routes are reused across conditions."""
    parameters = board.parameters(setting, method)
    routes = None
    if isinstance(driver, RouteFollower):
        identity: dict[str, Any] = {"method": method.identity, "place": setting.place.identity}
        identity |= {"scanner": parameters.scanner.to_yaml(), "robot": repr(parameters.robot)}
        identity |= {"layer": parameters.cost_layer, "odometry": repr(parameters.odometry)}
        identity |= {"start_std": list(parameters.start_std)}
        routes = work / f"routes-{key_of(identity)}.npz"
        driver.routes.load(routes)
    try:
        return evaluate(driver, source, parameters, board.episodes, board.seed, progress=progress)
    finally:
        if routes is not None:
            driver.routes.save(routes)
