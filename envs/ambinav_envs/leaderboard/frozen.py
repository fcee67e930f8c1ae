"""The frozen benchmark: tasks, buildings and seeds that stay as they are, and its episodes."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import yaml

from ambinav.buildings.load import load_environment
from ambinav.geometry.environment import Environment
from ambinav.maps.content_digest import environment_digest
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import sha256
from ambinav.runtime.progress import Stages
from ambinav.runtime.provenance import digest_of
from ambinav_envs.buildings.suites import suite
from ambinav_envs.evaluation import CHUNK, evaluate_seeds
from ambinav_envs.leaderboard.board import Board, Setting, Venue, fitting, source_for, venue_of_task
from ambinav_envs.leaderboard.methods import Method
from ambinav_envs.registered import arguments_of_id
from ambinav_envs.simulation.layout import OUTCOMES

DEFINITION: Final = Path(__file__).with_name("benchmark_v1.yaml")
DRAWN: Final = "drawn"
"""The part of the benchmark in drawn buildings, whose score is that of the benchmark."""
RECORDED: Final = "recorded"
"""The same tasks in recorded maps, which not everybody has."""
PARTS: Final = (DRAWN, RECORDED)
QUICK_BUILDINGS: Final = 3


class Outcome(NamedTuple):
    """Outcome of an episode.

    Attributes:
        building: Key of the building.
        seed: Seed of the episode, for `NavigationEnv.reset`, with that building.
        ended: One of `layout.OUTCOMES`.
        seconds: Duration, seconds.
        score: `Episodes.sct`.
    """

    building: str
    seed: int
    ended: str
    seconds: float
    score: float


@dataclass(frozen=True)
class FrozenBenchmark:
    """Definition of a version of the benchmark.

    Attributes:
        version: Its number.
        digest: SHA-256 of the file that defines it.
        seed: Public seed, of which those of all episodes are made.
        commitment: SHA-256 of the file with the hidden seed.
        first: Number of the first building of each suite.
        episodes: Number of episodes in each building.
        map_episodes: The same in each recorded map.
        tasks: Digest of the arguments of each task, by its id.
        buildings: Digests of the buildings of each suite, in order.
        maps: Digest of each recorded map, by its file relative to the folder of maps.
    """

    version: int
    digest: str
    seed: int
    commitment: str
    first: int
    episodes: int
    map_episodes: int
    tasks: Mapping[str, str]
    buildings: Mapping[str, Sequence[str]]
    maps: Mapping[str, str]

    @classmethod
    def read(cls, path: Path = DEFINITION) -> FrozenBenchmark:
        """Read a definition."""
        return cls(digest=sha256(path), **yaml.safe_load(path.read_text(encoding="utf-8")))

    def quick(self) -> FrozenBenchmark:
        """Return a few of the episodes, for a trial that is no submission."""
        few = {name: digests[:QUICK_BUILDINGS] for name, digests in self.buildings.items()}
        return replace(self, buildings=few, episodes=1, map_episodes=1)

    def hidden_seed(self, path: Path) -> int:
        """Return the hidden seed from a maintainer's file.

        Raises:
            InputError: it is not the file that the benchmark was committed to.
        """
        try:
            digest = sha256(path)
        except OSError as error:
            raise InputError(f"--secret: {path} cannot be read ({error.strerror}).") from error
        if digest != self.commitment:
            raise InputError(
                f"--secret: {path} has the SHA-256 {digest[:12]}..., and benchmark v{self.version} "
                f"is committed to {self.commitment[:12]}...; give the file as it was made."
            )
        return int(json.loads(path.read_text(encoding="utf-8"))["seed"], 16)

    def venues(self, maps: Path | None) -> Iterator[tuple[str, str, Venue]]:
        """Yield part, task and venue of all episodes, after checking that they are the frozen ones.

        Args:
            maps: Folder of the recorded maps; None: without that part.

        Raises:
            InputError: a task, a building or a map is another than the frozen one, or is missing.
        """
        for name, digests in self.buildings.items():
            for number, digest in enumerate(digests, self.first):
                building = suite(name).building(number)
                self._check(building.name, environment_digest(building), digest)
        recorded = [] if maps is None else [self._map(maps, *item) for item in self.maps.items()]
        for task, digest in self.tasks.items():
            self._check(task, digest_of(arguments_of_id(task)), digest)
            venue = replace(venue_of_task(task, 1), first=self.first)
            name = str(venue.what)
            yield DRAWN, task, replace(venue, name=name, count=len(self.buildings[name]))
            for built in recorded:
                yield RECORDED, task, replace(venue, name=built.name, what=built, count=None)

    def episodes_of(self, part: str, task: str) -> list[tuple[str, int]]:
        """Return key of the building and public seed of each episode of a task, in order.

        Args:
            part: One of `PARTS`.
            task: One of its tasks.
        """
        keys, count = [Path(name).stem for name in self.maps], self.map_episodes
        if part == DRAWN:
            name, count = str(venue_of_task(task, 1).what), self.episodes
            numbers = range(self.first, self.first + len(self.buildings[name]))
            keys = [f"{name}-{number}" for number in numbers]
        return [(key, seed) for key in keys for seed in seeds_of(self.seed, task, key, count)]

    def _map(self, folder: Path, name: str, digest: str) -> Environment:
        path = folder / name
        if not path.is_file():
            raise InputError(
                f"--recorded: {path} is missing; put the map there, or leave --recorded out."
            )
        environment = load_environment(path)
        self._check(str(path), environment_digest(environment), digest)
        return environment

    def _check(self, name: str, ours: str, digest: str) -> None:
        if ours != digest:
            raise InputError(
                f"benchmark v{self.version}: {name} is not the frozen one (digest {ours[:12]}..., "
                f"frozen {digest[:12]}...); use the file or the version of ambinav that it is "
                "from, or a newer version of the benchmark."
            )


def seeds_of(seed: int, task: str, building: str, count: int) -> list[int]:
    """Return the seeds of the episodes of a task in a building.

    They have 63 bits, so that nobody finds hidden ones by trying them all.
    """
    where = zlib.crc32(f"{task} {building}".encode())
    return [
        int(np.random.SeedSequence([seed, where, k]).generate_state(1, np.uint64)[0] >> 1)
        for k in range(count)
    ]


def drive(
    frozen: FrozenBenchmark,
    methods: Mapping[str, Method],
    seed: int,
    maps: Path | None,
    begin: Stages,
) -> dict[str, dict[str, list[Outcome]]]:
    """Drive all episodes, after checking all that they depend on.

    Args:
        frozen: The benchmark.
        methods: The policy of each task.
        seed: Public or hidden seed.
        maps: See `FrozenBenchmark.venues`.
        begin: Given a text, returns what takes the share done.

    Returns:
        The outcomes by part and task.

    Raises:
        InputError: see `FrozenBenchmark.venues`, or a policy does not fit its task.
    """
    jobs = []
    for part, task, venue in frozen.venues(maps):
        setting = Setting(f"{task}, {venue.name}", venue, "as mapped", {})
        board = fitting(Board([methods[task]], [setting], frozen.episodes, seed))
        jobs.append((part, task, setting, board))
    driven: dict[str, dict[str, list[Outcome]]] = {}
    for part, task, setting, board in jobs:
        (method,) = board.methods
        source, parameters = source_for(board, setting, {}), board.parameters(setting, method)
        drawn = part == DRAWN
        count = frozen.episodes if drawn else frozen.map_episodes
        numbers = range(source.first, source.first + (source.count or 1))
        keys = [f"{source.name}-{number}" if drawn else source.name for number in numbers]
        seeds = np.array([seeds_of(seed, task, key, count) for key in keys]).ravel()
        where, bar = np.repeat(numbers, count).tolist(), begin(setting.name)
        episodes = evaluate_seeds(
            method.make(parameters), source, parameters, seeds, where,
            chunk=min(CHUNK, len(seeds)), progress=bar,
        )  # fmt: skip
        bar(1.0)
        columns = episodes.building, seeds, episodes.outcome, episodes.seconds
        driven.setdefault(part, {}).setdefault(task, []).extend(
            Outcome(str(building), int(episode_seed), OUTCOMES[ended], float(seconds), float(score))
            for building, episode_seed, ended, seconds, score in zip(
                *columns, episodes.sct(parameters.robot.max_speed), strict=True
            )
        )
    return driven
