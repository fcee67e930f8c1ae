"""N robots, each in an episode of its own: the simulation behind the environments."""

from __future__ import annotations

from bisect import bisect_right
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.config import nearest
from ambinav.localization.ekf_update import Scratch, scratch_for
from ambinav.localization.random import states_of_each, uniform
from ambinav.runtime.array_types import Bools, Floats, Ints, UInts
from ambinav.runtime.compiling import announce
from ambinav.runtime.errors import InputError
from ambinav.runtime.threads import share
from ambinav_envs.buildings.source import BuildingSource
from ambinav_envs.buildings.tasks import Task
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.plugged import PluggedFunctions
from ambinav_envs.simulation.disturbances import (
    BUILDINGS,
    TASKS,
    Disturbances,
    draw_disturbances,
    no_task,
)
from ambinav_envs.simulation.layout import (
    BUILDING,
    COLUMNS,
    LATE,
    LOCALIZERS,
    MCL,
    MOTIONS,
    PARTICLES,
    RUNNING,
    STATE,
    STREAMS,
    TASK,
    Memory,
    View,
)
from ambinav_envs.simulation.outcome import Outcome
from ambinav_envs.simulation.particles import ParticleFilters
from ambinav_envs.simulation.scanner_kernel import scanner_arrays
from ambinav_envs.simulation.settings import settings_of
from ambinav_envs.simulation.site import Site, Sites
from ambinav_envs.simulation.step import (
    BEGIN,
    BLOCK,
    DRIVE,
    JUDGE,
    OBSERVE,
    PLACE,
    SENSE,
    STEP,
    WORLD,
    advance,
)
from ambinav_envs.spaces import columns_of

OPTIONS = ("start", "goal", "building")
"""Options of `reset`."""

# So many robots are worth waking a thread for: with fewer it costs what it saves.
SHARED = 96
# The same with particle filters, which take some twenty times as long.
SHARED_FILTERS = 8
# For robots that do not act.
NOTHING: Floats = np.empty((0, MOTIONS))


class _Episode(NamedTuple):
    """An episode that is drawn and has not begun."""

    site: Site
    task: Task
    disturbances: Disturbances | None


class Simulation:
    """N robots in buildings.

    Args:
        source: Source of the buildings.
        parameters: Everything else.
        count: N.

    Attributes:
        parameters: The given value.
        count: N.
        state: `layout.STATE`, shape (N,); read it, do not write to it.
        sites: The building around each robot.
        tasks: Start, goal and cost to go of each.
    """

    def __init__(
        self, source: BuildingSource, parameters: NavigationParameters, count: int
    ) -> None:
        announce()
        self.source = source
        self.parameters = parameters
        self.count = count
        self.sites: list[Site | None] = [None] * count
        self.tasks: list[Task | None] = [None] * count
        self._scanner = scanner_arrays(parameters.scanner)
        self._site_cache = Sites(parameters, self._scanner)
        # For the threads, each of which takes one while it works; by the number of rays, of which
        # cones have more in space.
        self._scratch: defaultdict[int, list[Scratch]] = defaultdict(list)
        # The site number of each robot.
        self._numbers = np.full(count, -1)
        self._everyone = np.arange(count)
        self._columns = columns_of(parameters)
        self._plugged = PluggedFunctions(parameters)
        self._filters: ParticleFilters | None = None
        if parameters.localizer == LOCALIZERS[MCL]:
            self._filters = ParticleFilters(parameters, count)
        late_rows = parameters.late_steps + 1 if parameters.late_steps else 0
        self._memory = Memory(
            np.zeros(count, dtype=STATE),
            np.zeros((count, parameters.people.count, 3)),
            np.zeros((count, parameters.obstacles + (parameters.closed_door > 0.0), 6)),
            np.zeros((count, parameters.scanner.beams)),
            np.zeros((count, late_rows), dtype=LATE),
            settings_of(parameters),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the prepared buildings, which unpickling makes again."""
        plain = self.__dict__.copy()
        plain["_site_cache"] = plain["_plugged"] = None
        plain["sites"] = [None if site is None else site.building.key for site in self.sites]
        return plain

    def __setstate__(self, plain: dict[str, Any]) -> None:
        """Prepare the buildings again."""
        self.__dict__.update(plain)
        self._plugged = PluggedFunctions(self.parameters)
        self._site_cache = Sites(self.parameters, self._scanner)
        keys: list[str | None] = plain["sites"]
        self.sites = [None] * self.count
        for i, key in enumerate(keys):
            task = self.tasks[i]
            if key is not None and task is not None:
                self._settle(i, self._site_cache.of(self.source.get(key)), task)

    @property
    def state(self) -> NDArray[np.void]:
        """`layout.STATE`, shape (N,)."""
        return self._memory.state

    @property
    def people(self) -> Floats:
        """Poses of the people, shape (N, P, 3)."""
        return self._memory.people

    @property
    def boxes(self) -> Floats:
        """Unmapped boxes, see `layout.Memory`; the first `state["boxes"]` of each robot count."""
        return self._memory.boxes

    @property
    def readings(self) -> Floats:
        """The latest readings, shape (N, B), metres: inf for no echo, -inf for too near."""
        return self._memory.readings

    def seen(self) -> tuple[Floats, Floats]:
        """Return the estimates that have reached the robots, shape (N, 3) and (N, 3, 3).

        Those in `state` are the latest; with a `pose_latency` these are older.
        """
        seen, late = self.state, self._memory.late
        if late.shape[1] > 0:
            seen = late[self._everyone, (seen["steps"] + 1) % late.shape[1]]
        return seen["mean"], seen["covariance"]

    @property
    def clusters(self) -> Floats:
        """Share, x, y and theta of each cluster of particles, heaviest first, shape (N, K, 4).

        K is `NavigationParameters.hypotheses`; zeros where there are no more. The observation
        `hypotheses` shows them, later by a `pose_latency`.
        """
        if self._filters is None:
            return np.zeros((self.count, 0, 4))
        return self._filters.clusters

    def outcome(self) -> Outcome:
        """Allocate the output arrays of a step."""
        parts = [np.empty((self.count, columns), np.float32) for columns in self._columns]
        plugged = self._plugged.arrays(self.count)
        return Outcome(View(*parts), np.empty((self.count, COLUMNS)), plugged)

    def reset(
        self,
        rows: Sequence[int],
        generators: Sequence[np.random.Generator],
        options: Mapping[str, Any] | None,
        out: Outcome,
    ) -> None:
        """Begin new episodes.

        If one of them is refused none begins; but where people find no room, which is known only
        then, those of `rows` have no episode that is of use.

        Args:
            rows: The robots.
            generators: The source of randomness of each of all N; one draw of it makes the streams
                of an episode, refused ones included.
            options: `start` (x, y, theta), `goal` (x, y), `building` (number or key); what is left
                out is drawn.
            out: Their rows are written.

        Raises:
            InputError: an option is unknown or of no use, or the building has no room for the
                robot, the task or the people.
        """
        checked = _checked(options)
        # First one draw for each robot, so that a refusal advances all random streams alike.
        streams = states_of_each([generators[i] for i in rows], STREAMS)
        episodes = [self._draw(robot_streams, checked) for robot_streams in streams]
        chosen = np.array(rows, dtype=np.int64)
        self._start(chosen, [episode.task for episode in episodes], streams)
        for i, episode, robot_streams in zip(rows, episodes, streams, strict=True):
            self._settle(i, episode.site, episode.task)
            self._set_disturbances(i, episode.disturbances)
            if self._filters is not None:
                self._filters.seed(i, robot_streams[PARTICLES])
        self._advance(chosen, BEGIN, out)
        self._plugged.after_reset(self.state, self.seen, self.readings, chosen, out.plugged)

    def step(self, actions: Floats, active: Bools | None, out: Outcome) -> None:
        """Step robots by one time step.

        Args:
            actions: Shape (N, columns), see `spaces.continuous`.
            active: Which robots, bool, shape (N,), the others stay as they are; None: all.
            out: Their rows are written.
        """
        rows = self._everyone if active is None else np.flatnonzero(active)
        self._advance(rows, STEP, out, actions)
        figures = out.figures
        self._plugged.after_step(self.state, self.seen, self.readings, rows, figures, out.plugged)

    def observe(self, out: Outcome) -> None:
        """Write the last observation of all robots again; zeros for robots without an episode.

        All terms of the reward are 0.
        """
        for part in (*out.view, out.figures):
            part[:] = 0.0
        rows = [i for i, site in enumerate(self.sites) if site is not None]
        if rows:
            chosen = np.array(rows, dtype=np.int64)
            self._advance(chosen, OBSERVE, out)
            self._plugged.after_reset(self.state, self.seen, self.readings, chosen, out.plugged)

    def _draw(self, streams: UInts, options: Mapping[str, Any]) -> _Episode:
        """Draw the values of an episode that the options do not set."""
        p = self.parameters
        building, start, goal = options["building"], options["start"], options["goal"]

        def draw(site: Site, aliased: Floats | None = None) -> Task:
            fixed_start = aliased if start is None else start
            return self._plugged.task.draw(site, streams[TASK], p.longest, fixed_start, goal)

        for _ in range(BUILDINGS if building is None and self.source.count != 1 else 1):
            share = uniform(streams[BUILDING])
            site = self._site_cache.of(
                self.source.at(share) if building is None else self.source.get(building)
            )
            tries = TASKS if start is None or goal is None else 1
            drawn = draw_disturbances(site, p, streams[TASK], draw, tries, options)
            if drawn is not None:
                break
        else:
            raise no_task(site, p)
        return _Episode(site, *drawn)

    def _settle(self, i: int, site: Site, task: Task) -> None:
        """Assign robot i to a building and a goal."""
        before = self.sites[i]
        if before is not None:
            before.costs_to_go.release(int(self.state["slot"][i]))
        self.sites[i], self.tasks[i] = site, task
        self._numbers[i] = site.number
        self.state["slot"][i] = site.costs_to_go.hold(task.cost_to_go)

    def _set_disturbances(self, i: int, disturbances: Disturbances | None) -> None:
        """Write the disturbances of robot i to the record of its starting episode."""
        if disturbances is None:
            return
        *numbers, door, starts = disturbances
        for name, value in zip(Disturbances._fields, numbers, strict=False):
            self.state[name][i] = value
        if starts is not None and self._filters is not None:
            self._filters.expect(i, starts)
        if door is not None:
            self.state["boxes"][i], self.boxes[i, 0], self.state["door"][i] = 1, door, True

    def _start(self, rows: Ints, tasks: Sequence[Task], streams: UInts) -> None:
        """Reset the records of robots whose episode starts."""
        fresh = np.zeros(len(rows), dtype=STATE)
        fresh["outcome"], fresh["random"] = RUNNING, streams
        fresh["slot"] = self.state["slot"][rows]
        fresh["truth"] = [task.start for task in tasks]
        fresh["goal"] = [task.goal for task in tasks]
        fresh["distance"] = [task.cost for task in tasks]
        fresh["shortest"] = [task.distance for task in tasks]
        self.state[rows] = fresh

    def _advance(self, rows: Ints, parts: int, out: Outcome, actions: Floats = NOTHING) -> None:
        """Run parts of a step for some robots, building by building, in threads."""
        rows, ends = self._by_building(rows)

        def advance_rows(low: int, high: int) -> None:
            while low < high:
                end = min(ends[bisect_right(ends, low)], high)
                site = self.sites[rows[low]]
                assert site is not None
                rays = len(site.record.cast.cosine)
                unused = self._scratch[rays]
                try:
                    scratch = unused.pop()
                except IndexError:
                    scratch = scratch_for(self.parameters.scanner.beams, rays)
                work(rows[low:end], site, parts, out, actions, scratch)
                unused.append(scratch)
                low = end

        work, least = self._kernel, SHARED
        if self._filters is not None:
            work, least = self._with_filters, SHARED_FILTERS
        share(advance_rows, len(rows), min(BLOCK, least) if len(rows) >= least else least)

    def _with_filters(
        self, rows: Ints, site: Site, parts: int, out: Outcome, actions: Floats,
        scratch: Scratch,
    ) -> None:  # fmt: skip
        """Run `_kernel` with the particle filters' kernel after the scan."""
        filters, particles = self._filters, site.particles
        assert filters is not None and particles is not None
        if parts & PLACE:
            self._kernel(rows, site, PLACE, out, actions, scratch)
            if self.parameters.start_unknown:
                filters.start_globally(rows, particles)
            else:
                filters.start(rows, self.state, particles)
                if self.parameters.start_aliases:
                    filters.share_out(rows, particles)
        if parts & SENSE:
            self._kernel(rows, site, parts & (DRIVE | SENSE), out, actions, scratch)
            helped = rows[self.state["helped"][rows]]
            if parts & DRIVE and len(helped):
                filters.start(helped, self.state, particles)
            filters.update(rows, self.state, self.readings, particles)
        self._kernel(rows, site, parts & (JUDGE | OBSERVE), out, actions, scratch)
        if parts & OBSERVE and self.parameters.hypotheses:
            filters.show(rows, self.state, out.view.hypotheses)

    def _kernel(
        self, rows: Ints, site: Site, parts: int, out: Outcome, actions: Floats,
        scratch: Scratch,
    ) -> None:  # fmt: skip
        """Run parts of a step for robots in one building, see `step.advance`."""
        if site.mesh_scan is not None and parts & SENSE:
            before, after = parts & (PLACE | DRIVE), parts & ~WORLD
            if before:
                self._kernel(rows, site, before, out, actions, scratch)
            site.mesh_scan.sense(rows, self._memory)
            if after:
                self._kernel(rows, site, after, out, actions, scratch)
            return
        pieces = [(site.record, parts)]
        if site.truth is not None:
            pieces = [(site.truth, parts & WORLD), (site.record, parts & ~WORLD)]
        for record, robots in pieces:
            full = advance(
                record, site.costs_to_go.arrays, self._scanner, self._memory, out.view, out.figures,
                actions, rows, robots, scratch,
            )  # fmt: skip
            if full >= 0:
                self._refuse(full)

    def _by_building(self, rows: Ints) -> tuple[Ints, list[int]]:
        """Sort robots by building; return them, and where each building's robots end."""
        if len(rows) == 1:
            return rows, [1]
        numbers = self._numbers[rows]
        order = np.argsort(numbers)
        ends = np.flatnonzero(np.diff(numbers[order])) + 1
        return rows[order], [*ends.tolist(), len(rows)]

    def _refuse(self, i: int) -> None:
        """Raise because there is no room for people around robot i."""
        site, people = self.sites[i], self.parameters.people
        assert site is not None
        raise InputError(
            f"people: there is no room for {people.count} with a radius of {people.radius:g} m "
            f"in {site.building.environment.name!r}; give fewer or smaller ones."
        )


def _checked(options: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return every option, None where it is not given."""
    if not isinstance(options, Mapping | None):
        raise InputError(f"reset: options is {options!r}; give a mapping.")
    checked: dict[str, Any] = dict.fromkeys(OPTIONS)
    for name, value in (options or {}).items():
        if name not in checked:
            raise InputError(
                f"reset: the option {name!r} is unknown; {nearest(str(name), checked)}."
            )
        checked[name] = value
    return checked
