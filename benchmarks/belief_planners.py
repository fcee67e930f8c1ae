"""Methods without learning for tasks in which the robot may be in several places.

Scripts read the observation alone. Planners have the map too, and the clusters of the localizer's
particles; none knows the true pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from task_baselines import Histogram

from ambinav.geometry.frames import between, compose
from ambinav.runtime.array_types import Bools
from ambinav.sensing.casting import cast_beams
from ambinav_envs.buildings.tasks import CostToGo, spread_from
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.rewards import weights_of
from ambinav_envs.simulation.layout import RUNNING
from ambinav_envs.simulation.observe import FAR, ahead, polar
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.simulation.site import Site

Floats = NDArray[np.float64]
# Share of the particles below which a hypothesis is left out.
LEAST = 0.02
# Places considered for a look in a building, and how many looks one after another.
PLACES, LOOKS = 96, 3
# Scans differ if so many beams do, by so much, metres.
BEAMS, DIFFERENT = 8, 0.3
# Speed on routes with their turns, as a share of the greatest.
PACE = 0.85
# Steps between two plans where the hypotheses stay as they are, and change of a share that counts.
STEPS, CHANGE = 25, 0.1
# Distance at which a place for a look is reached, metres.
REACHED = 0.3


class Declares(Histogram):
    """Follows the route by the heaviest hypothesis, and does something else while unsure.

    Args:
        parameters: Parameters of the environment.
        sure: Share of the heaviest hypothesis from which it is followed.
    """

    def __init__(self, parameters: NavigationParameters, sure: float = 0.0) -> None:
        super().__init__(parameters)
        self._sure = sure

    def act(self, observations: Observation, starts: Bools) -> Any:
        """Drive, and declare where the heaviest hypothesis is at the goal."""
        unsure = observations["hypotheses"][:, 0] < self._sure
        point = observations[self._point].copy()
        point[unsure] = 0.12, 1.0, 0.0
        # Who is unsure neither stands nor declares at the goal.
        goal = observations["goal"].copy()
        goal[unsure, 0] = 1.0
        actions = self.towards({**observations, "goal": goal}, point)
        self._search(observations, starts, unsure, actions)
        return actions

    def _search(
        self, observations: Observation, starts: Bools, unsure: Bools, actions: Floats
    ) -> None:
        """Change the actions of robots that are unsure; these drive on where there is room."""


class FollowsWall(Declares):
    """Drives along the wall on its left while unsure, and so into every passage."""

    NEAR, BESIDE = 0.9, 0.5

    def __init__(self, parameters: NavigationParameters, sure: float) -> None:
        super().__init__(parameters, sure)
        self._has_wall = np.zeros(0, dtype=np.bool_)

    def _search(
        self, observations: Observation, starts: Bools, unsure: Bools, actions: Floats
    ) -> None:
        if len(self._has_wall) != len(starts):
            self._has_wall = np.zeros(len(starts), dtype=np.bool_)
        ranges = self._far * observations["scan"].astype(np.float64)
        left = ranges[:, (self._angle > 0.7) & (self._angle < 2.4)].min(axis=1)
        front = ranges[:, np.abs(self._angle) < 0.6].min(axis=1)
        self._has_wall = ~starts & (self._has_wall | (np.minimum(left, front) < self.NEAR))
        follows = unsure & self._has_wall
        turn = np.clip(1.5 * (np.minimum(left, 2.0 * self.BESIDE) - self.BESIDE), -0.5, 0.5)
        blocked = front < self.BESIDE
        turn = np.where(blocked, -0.5, turn)
        actions[follows, 0] = np.where(blocked, -1.0, 0.6)[follows]
        actions[follows, 1] = turn[follows]


class Looks(NamedTuple):
    """What is known of a building before an episode: places, and what is seen there.

    Attributes:
        places: x and y, shape (C, 2).
        scans: Ranges there at the heading 0, shape (C, B), metres.
        apart: Paths between them, shape (C, C), metres.
    """

    places: Floats
    scans: Floats
    apart: Floats

    @classmethod
    def of(cls, site: Site) -> Looks:
        """Spread places over a building, each as far from the others as possible."""
        table = site.lattice.table
        columns = table.room.shape[1]
        cells = table.standing[table.labels.ravel()[table.standing] == 0]
        x = table.low_x + table.spacing * (cells % columns)
        y = table.low_y + table.spacing * (cells // columns)
        every = np.column_stack([x, y])
        chosen, off = [0], np.full(len(every), np.inf)
        while len(chosen) < min(PLACES, len(every)):
            off = np.minimum(off, np.hypot(*(every - every[chosen[-1]]).T))
            chosen.append(int(np.argmax(off)))
        places = every[chosen]
        scans = scans_at(site, np.column_stack([places, np.zeros(len(places))]))
        fields = [building_field(site, place) for place in places]
        apart = np.array([[site.lattice.distance(f, *p) for p in places] for f in fields])
        return cls(places, scans, apart)


def building_field(site: Site, place: Floats) -> NDArray[np.float32]:
    """Return the metres to a place from each cell of a building's lattice."""
    field = np.empty(site.lattice.room.shape, dtype=np.float32)
    spread_from(float(place[0]), float(place[1]), site.lattice.table, field)
    return field


def scans_at(site: Site, poses: Floats) -> Floats:
    """Return the ranges that the map predicts at poses, shape (C, B), metres."""
    rays = site.building.scanner.rays()
    far = float(rays.max_range.max())
    ranges = cast_beams(site.building.environment, rays, far, *poses.T.copy())
    # Inside of walls no scan is possible: it is like no other.
    return np.nan_to_num(ranges.astype(np.float64), nan=-far, posinf=far)


def heaviest(simulation: Simulation, i: int) -> Floats:
    """Return share and pose of each hypothesis of robot i that counts, heaviest first."""
    clusters = simulation.clusters[i]
    return clusters[: max(int((clusters[:, 0] >= LEAST).sum()), 1)]


def driven_towards(
    drive: Histogram, observations: Observation, points: NDArray[np.float32], arrived: Bools
) -> Any:
    """Return actions towards points; who has arrived stands and declares it, and nobody else."""
    goal = np.where(arrived, 0.0, 1.0)[:, None] * np.float32([1.0, 1.0, 0.0])
    return drive.towards({**observations, "goal": goal}, points)


class Planner:
    """Chooses where to drive and when to declare, for the greatest expected reward.

    A hypothesis is a cluster of particles. The robot follows the route of one of them and declares
    at its goal, or drives to a place where the map says that its scan would differ by hypothesis,
    and chooses there. `looks` such places one after another are planned: over hypotheses, places
    and routes this is the exact expectation of arrival, false declaration and time, if looks show
    what the map says. What is seen on the way counts when it is seen, since it then plans again.

    Args:
        parameters: Parameters of the environment.
        looks: 0: the best hypothesis now, a point estimate.
    """

    def __init__(self, parameters: NavigationParameters, looks: int = LOOKS) -> None:
        self._p, self._looks = parameters, looks
        self._drive = Histogram(parameters)
        weights = weights_of(parameters.reward)
        self._arrival, self._missed = weights["arrival"], weights["missed"]
        self._metre = weights["time"] / (PACE * parameters.robot.max_speed)
        self._looks_by_key: dict[str, Looks] = {}
        self._plans: dict[int, tuple[int, Any, Any]] = {}
        # Which places a robot has been at; who has looked there need not look again.
        self._been: dict[int, NDArray[np.bool_]] = {}

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Forget the plans."""
        self._plans, self._been = {}, {}
        for i in rows:
            site = simulation.sites[i]
            assert site is not None
            if self._looks and site.building.key not in self._looks_by_key:
                self._looks_by_key[site.building.key] = Looks.of(site)
            self._been[i] = np.zeros(PLACES, dtype=np.bool_)

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Plan where that is due, and drive."""
        count, p = simulation.count, self._p
        points = np.tile(np.float32([0.0, 1.0, 0.0]), (count, 1))
        arrived = np.zeros(count, dtype=np.bool_)
        for i in np.flatnonzero(simulation.state["outcome"] == RUNNING):
            site, task = simulation.sites[i], simulation.tasks[i]
            assert site is not None and task is not None
            step, hypotheses = int(simulation.state["steps"][i]), heaviest(simulation, i)
            planned = self._plans.get(i)
            if self._looks:
                looks = self._looks_by_key[site.building.key]
                off = np.hypot(*(looks.places - hypotheses[0, 1:3]).T)
                self._been[i][: len(off)] |= off <= REACHED
            if planned is None or self._due(step, hypotheses, planned):
                planned = step, hypotheses[:, 0].copy(), self._plan(i, site, task, hypotheses)
                self._plans[i] = planned
            which, place, towards = planned[2]
            x, y, theta = hypotheses[min(which, len(hypotheses) - 1), 1:]
            target = task.goal if place is None else place
            off = float(np.hypot(x - target[0], y - target[1]))
            if place is None:
                arrived[i] = off <= p.goal_radius
            elif off <= REACHED:
                del self._plans[i]
            wx, wy = ahead(x, y, target, p.waypoint_distance, towards, site.lattice.frame)
            polar(x, y, np.cos(theta), np.sin(theta), wx, wy, points, i)
        return driven_towards(self._drive, observations, points, arrived)

    def _due(self, step: int, hypotheses: Floats, planned: tuple[int, Floats, Any]) -> bool:
        before = planned[1]
        if len(hypotheses) != len(before) or step - planned[0] >= STEPS:
            return True
        return bool(np.abs(hypotheses[:, 0] - before).max() > CHANGE)

    def _plan(self, i: int, site: Site, task: Any, hypotheses: Floats) -> tuple[int, Any, Any]:
        """Return the hypothesis to drive by, a place or None for the goal, and the route there."""
        share, poses = hypotheses[:, 0] / hypotheses[:, 0].sum(), hypotheses[:, 1:]
        to_goal = task.cost_to_go.costs
        to_go = [site.lattice.distance(to_goal, x, y) for x, y, _ in poses]
        commit = [self._end(share, k, to_go[k]) for k in range(len(share))]
        best = int(np.argmax(commit))
        if self._looks and len(share) > 1:
            looks = self._looks_by_key[site.building.key]
            gain = self._look(site, to_goal, share, poses, looks)
            gain[self._been[i][: len(gain)]] = -np.inf
            place = int(np.argmax(gain))
            if gain[place] > commit[best]:
                target = looks.places[place]
                field = building_field(site, target)
                return 0, target, CostToGo.of(field, site.lattice.table).towards
        return best, None, task.cost_to_go.towards

    def _end(self, share: Floats, k: int, metres: Any) -> Any:
        """Return the expected reward of driving to the goal by hypothesis k and declaring there."""
        total = share.sum()
        metres = np.where(np.isfinite(metres), metres, 1e3)
        lost = self._missed * (total - share[k])
        return self._arrival * share[k] - lost - total * self._metre * metres

    def _look(
        self, site: Site, to_goal: NDArray[np.float32], share: Floats, poses: Floats, looks: Looks
    ) -> Floats:
        """Return the expected reward of a first look at each place, shape (C,).

        Value iteration over the sets of hypotheses that looks leave.
        """
        count, places = len(share), len(looks.places)
        offsets = between(poses[0], np.column_stack([looks.places, np.zeros(places)]))
        targets = [looks.places]
        targets += [compose(poses[k], offsets)[:, :2] for k in range(1, count)]
        scans = [looks.scans] + [
            scans_at(site, compose(poses[k], offsets)) for k in range(1, count)
        ]
        to_go = [
            np.array([site.lattice.distance(to_goal, *at) for at in targets[k].tolist()])
            for k in range(count)
        ]
        alike = {
            (j, k): (np.abs(scans[j] - scans[k]) > DIFFERENT).sum(axis=1) < BEAMS
            for j, k in combinations(range(count), 2)
        }
        sets = [s for n in range(1, count + 1) for s in combinations(range(count), n)]
        ends = {s: self._best_end(share, s, to_go) for s in sets}
        value = dict(ends)
        for _ in range(self._looks - 1):
            value = {s: self._after(share, s, ends[s], value, alike, looks.apart) for s in sets}
        everyone = sets[-1]
        field = building_field(site, poses[0, :2])
        first = np.array([site.lattice.distance(field, *at) for at in looks.places.tolist()])
        return self._after_look(everyone, value, alike) - self._metre * first

    def _best_end(self, share: Floats, members: tuple[int, ...], to_go: list[Floats]) -> Floats:
        member_share = share[list(members)]
        return np.max([self._end(member_share, n, to_go[k]) for n, k in enumerate(members)], axis=0)

    def _after_look(
        self, members: tuple[int, ...], value: dict[Any, Floats], alike: dict[Any, Any]
    ) -> Floats:
        """Return the expected reward after a look at each place, which leaves some of them."""
        total = np.zeros_like(next(iter(value.values())))
        for place in range(len(total)):
            remaining = list(members)
            while remaining:
                first, *candidates = remaining
                group = (first, *(k for k in candidates if alike[first, k][place]))
                total[place] += value[group][place]
                remaining = [k for k in remaining if k not in group]
        return total

    def _after(
        self,
        share: Floats,
        members: tuple[int, ...],
        end: Floats,
        value: dict[Any, Floats],
        alike: dict[Any, Any],
        distance: Floats,
    ) -> Floats:
        """Return the reward from each place: an end, or the best further look."""
        if len(members) == 1:
            return end
        total = share[list(members)].sum()
        further = self._after_look(members, value, alike) - self._metre * total * distance
        return np.maximum(end, further.max(axis=1))


class QMdp:
    """Drives where the cost to the goal becomes least on average over the hypotheses.

    QMDP (Littman, Cassandra and Kaelbling 1995): as if the true pose were known after the next
    step. So it declares only where all hypotheses are at their goals, and never looks.
    """

    HEADINGS, STEP = 16, 0.5

    def __init__(self, parameters: NavigationParameters) -> None:
        self._p, self._drive = parameters, Histogram(parameters)

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Do nothing: it needs no preparation."""

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Choose among headings."""
        count, p = simulation.count, self._p
        angles = np.arange(self.HEADINGS) * 2.0 * np.pi / self.HEADINGS
        points = np.tile(np.float32([self.STEP / FAR, 1.0, 0.0]), (count, 1))
        arrived = np.zeros(count, dtype=np.bool_)
        for i in np.flatnonzero(simulation.state["outcome"] == RUNNING):
            site, task = simulation.sites[i], simulation.tasks[i]
            assert site is not None and task is not None
            hypotheses = heaviest(simulation, i)
            cost = np.zeros(self.HEADINGS)
            for share, x, y, theta in hypotheses:
                for h, angle in enumerate(theta + angles):
                    at = x + self.STEP * np.cos(angle), y + self.STEP * np.sin(angle)
                    metres = site.lattice.distance(task.cost_to_go.costs, *at)
                    cost[h] += share * (metres if np.isfinite(metres) else 1e3)
            best = angles[int(np.argmin(cost))]
            points[i, 1:] = np.cos(best), np.sin(best)
            off = np.hypot(*(hypotheses[:, 1:3] - task.goal).T)
            arrived[i] = (off <= p.goal_radius).all()
        return driven_towards(self._drive, observations, points, arrived)
