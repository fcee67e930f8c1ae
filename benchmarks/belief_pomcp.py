"""POMCP over the hypotheses of a particle filter, see `belief_planners`.

The belief is that of the environment's own filter: shares and mean poses of its clusters. What the
tree simulates is coarser than the environment: drives of the length of the shortest path at a
constant speed, and scans as the map predicts them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from belief_planners import (
    DIFFERENT,
    PACE,
    REACHED,
    Floats,
    Looks,
    building_field,
    driven_towards,
    heaviest,
    scans_at,
)
from pomcp import Pomcp
from task_baselines import Histogram

from ambinav.geometry.frames import between, compose
from ambinav.runtime.array_types import Bools
from ambinav_envs.buildings.tasks import CostToGo
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.normalization import Observation
from ambinav_envs.rewards import weights_of
from ambinav_envs.simulation.layout import RUNNING
from ambinav_envs.simulation.observe import ahead, polar
from ambinav_envs.simulation.simulation import Simulation
from ambinav_envs.simulation.site import Site

# Simulations of a plan, their exploration in units of reward, and actions in a row.
SIMULATIONS, EXPLORATION, DEPTH = 256, 0.3, 4
# Places that the tree has: the best by themselves.
CANDIDATES = 8
# Evidence of a beam that differs, nats, and the most of a scan. The filter weighs the logarithm of
# a beam's likelihood, some 1.5 nats, with 0.1, and takes some two scans about a place.
EVIDENCE, MOST = 0.3, 4.0
# Change of a share that ends a drive to a place.
CHANGE = 0.15
# A place is given up after its expected time times a factor, and some seconds to turn.
LATE, SPARE = 1.5, 4.0
# Metres around a place that was seen in which none is looked at again.
BESIDE = 0.6
# Metres off which a cluster is not the one that was driven by.
SAME = 1.0


class Prices(NamedTuple):
    """Worth of an arrival, cost of a false declaration, of a second, and metres of a second."""

    arrival: float
    missed: float
    second: float
    speed: float


class Looking(NamedTuple):
    """A state in the simulations.

    Attributes:
        truth: Which hypothesis is true.
        place: Where the robot is; the last one is where it is now.
        left: Seconds that are left.
        belief: Probability of each hypothesis given the simulated history.
        been: Places of that history, a bit each.
    """

    truth: int
    place: int
    left: float
    belief: tuple[float, ...]
    been: int


class LookModel:
    """A robot in one of K places that looks around in C others, and ends by one hypothesis.

    Action 0 drives to the goal by the hypothesis of the best expectation given the history, and
    declares it. Action c + 1 drives to place c and takes a scan. That is taken for one of
    hypothesis j with a probability in proportion to exp(-evidence): the more beams differ between j
    and the true hypothesis, the less. A reward is the mean over the hypotheses given the history,
    whose expectation is that of the true one.

    Args:
        evidence: Of a scan at a place against j if k is true, shape (K, K, C), nats; 0 for j = k.
        to_goal: Metres from each place, and from here, to the goal by each hypothesis, (K, C + 1).
        apart: Metres between places and here, shape (C + 1, C + 1).
        prices: See there.
    """

    def __init__(self, evidence: Floats, to_goal: Floats, apart: Floats, prices: Prices) -> None:
        likelihood = np.exp(-evidence)
        likelihood /= likelihood.sum(axis=0)
        self._count, self._places = len(to_goal), len(apart) - 1
        # Read an entry at a time, where lists are quicker: [place][truth][taken for].
        self._likelihood = likelihood.transpose(2, 1, 0).tolist()
        self._to_goal, self._apart = to_goal.T.tolist(), apart.tolist()
        self._prices = prices

    def actions(self, state: Looking) -> Sequence[int]:
        """Return the end, and the places where the robot has not been."""
        return [0, *(c + 1 for c in range(self._places) if not state.been >> c & 1)]

    def best_end(self, state: Looking) -> int:
        """Return the hypothesis to end by."""
        return max(range(self._count), key=lambda k: self.end(state, k))

    def end(self, state: Looking, k: int) -> float:
        """Return the expected reward of driving to the goal by hypothesis k and declaring there."""
        prices = self._prices
        seconds = float(self._to_goal[state.place][k]) / prices.speed
        if seconds > state.left:
            return -prices.second * state.left
        right = state.belief[k]
        return right * prices.arrival - (1.0 - right) * prices.missed - prices.second * seconds

    def step(
        self, state: Looking, action: int, rng: np.random.Generator
    ) -> tuple[Looking | None, int, float]:
        """See `pomcp.Generative`; what is observed is the hypothesis that the scan is taken for."""
        if action == 0:
            return None, 0, self.rollout(state, rng)
        place = action - 1
        seconds = self._apart[state.place][place] / self._prices.speed
        if seconds >= state.left:
            return None, 0, -self._prices.second * state.left
        likelihood = self._likelihood[place]
        threshold, taken = rng.random(), 0
        for j, p in enumerate(likelihood[state.truth]):
            taken, threshold = j, threshold - p
            if threshold < 0.0:
                break
        weights = [b * row[taken] for b, row in zip(state.belief, likelihood, strict=True)]
        total = sum(weights)
        belief = tuple(w / total for w in weights)
        been = state.been | 1 << place
        after = Looking(state.truth, place, state.left - seconds, belief, been)
        return after, taken, -self._prices.second * seconds

    def rollout(self, state: Looking, rng: np.random.Generator) -> float:
        """Return the reward of the best end by the history."""
        return max(self.end(state, k) for k in range(self._count))


def one_look(
    evidence: Floats, to_goal: Floats, first: Floats, belief: Floats, prices: Prices
) -> Any:
    """Return the expected reward of each place if it is the last one looked at, shape (C,)."""
    likelihood = np.exp(-evidence)
    likelihood /= likelihood.sum(axis=0)
    # Probability that a scan is taken for j and k is true: (j, k, c).
    joint = likelihood * belief[:, None]
    worth = np.eye(len(belief)) * (prices.arrival + prices.missed) - prices.missed
    ends = np.einsum("jkc,ek->jec", joint, worth)
    ends -= joint.sum(axis=1)[:, None] * (prices.second / prices.speed) * to_goal
    return ends.max(axis=1).sum(axis=0) - prices.second / prices.speed * first


class Drive(NamedTuple):
    """A macro-action under way.

    Attributes:
        pose: Of the hypothesis that is driven by, as it was last seen, shape (3,).
        shares: Of the hypotheses when it was planned.
        target: x and y, metres.
        towards: The route there, see `CostToGo`.
        ends: Whether the target is the goal, where the arrival is declared.
        late: With fewer seconds left in the episode the place is given up.
    """

    pose: Floats
    shares: Floats
    target: Floats
    towards: Any
    ends: bool
    late: float


class TreeSearch:
    """Drives to places and to the goal as POMCP plans it over the clusters of the particle filter.

    A drive goes on until it is at its end, a share has changed by `CHANGE`, the cluster that it
    goes by is gone, or the place turns out not to be reached. Nobody looks twice near one place,
    which odometry recognizes whatever the hypothesis: the second scan would say the same.

    Args:
        parameters: Parameters of the environment.
        simulations: 0: the best single look or end, without a tree.
    """

    def __init__(self, parameters: NavigationParameters, simulations: int = SIMULATIONS) -> None:
        self._p, self._simulations = parameters, simulations
        self._drive = Histogram(parameters)
        weights = weights_of(parameters.reward)
        speed = PACE * parameters.robot.max_speed
        self._prices = Prices(weights["arrival"], weights["missed"], weights["time"], speed)
        self._looks_by_key: dict[str, Looks] = {}
        self._drives: dict[int, Drive] = {}
        # Where a robot has looked, or could not, x and y in the frame of its odometry.
        self._been: dict[int, list[Floats]] = {}
        self._rng: dict[int, np.random.Generator] = {}

    def begin(self, simulation: Simulation, rows: Sequence[int]) -> None:
        """Forget the drives."""
        self._drives = {}
        for i in rows:
            site = simulation.sites[i]
            assert site is not None
            if site.building.key not in self._looks_by_key:
                self._looks_by_key[site.building.key] = Looks.of(site)
            self._been[i] = []
            self._rng[i] = np.random.default_rng(i)

    def act(self, observations: Observation, starts: Bools, simulation: Simulation) -> Any:
        """Plan where that is due, and drive."""
        p = self._p
        points = np.tile(np.array([0.0, 1.0, 0.0], np.float32), (simulation.count, 1))
        arrived = np.zeros(simulation.count, dtype=np.bool_)
        for i in np.flatnonzero(simulation.state["outcome"] == RUNNING).tolist():
            site, task = simulation.sites[i], simulation.tasks[i]
            assert site is not None and task is not None
            hypotheses = heaviest(simulation, i)
            left = (p.max_steps - int(simulation.state["steps"][i])) * p.dt
            drive = _continued(self._drives.get(i), hypotheses)
            if drive is not None and not drive.ends and left < drive.late:
                self._been[i].append(self._by_odometry(simulation, i, drive.pose, drive.target)[0])
                drive = None
            if drive is None:
                drive = self._plan(simulation, i, hypotheses, left)
            self._drives[i] = drive
            x, y, theta = drive.pose
            near = np.hypot(*(drive.target - drive.pose[:2]))
            arrived[i] = drive.ends and near <= p.goal_radius
            if near <= REACHED and not drive.ends:
                self._been[i].append(simulation.state["odometry"][i, :2].copy())
                del self._drives[i]
            way = ahead(x, y, drive.target, p.waypoint_distance, drive.towards, site.lattice.frame)
            polar(x, y, np.cos(theta), np.sin(theta), *way, points, i)
        return driven_towards(self._drive, observations, points, arrived)

    def _plan(self, simulation: Simulation, i: int, hypotheses: Floats, left: float) -> Drive:
        """Choose what to do next."""
        site, task = simulation.sites[i], simulation.tasks[i]
        assert site is not None and task is not None
        shares, poses = hypotheses[:, 0], hypotheses[:, 1:]
        belief, count = shares / shares.sum(), len(shares)
        goal = task.cost_to_go
        here = [_metres(site, goal.costs, poses[[k], :2]) for k in range(count)]
        looks = self._looks_by_key[site.building.key]
        unseen = np.full(len(looks.places), count > 1)
        at = self._by_odometry(simulation, i, poses[0], looks.places)
        for been in self._been[i]:
            unseen &= np.hypot(*(at - been).T) > BESIDE
        places = np.flatnonzero(unseen)
        evidence, to_goal = self._seen_at(site, goal.costs, poses, looks, places)
        first = _metres(site, building_field(site, poses[0, :2]), looks.places[places])
        alone = one_look(evidence, to_goal, first, belief, self._prices)
        order = np.argsort(-alone)[:CANDIDATES]
        chosen = places[order]
        apart = np.zeros((len(order) + 1,) * 2)
        apart[:-1, :-1] = looks.apart[np.ix_(chosen, chosen)]
        apart[-1, :-1] = apart[:-1, -1] = first[order]
        to_goal = np.column_stack([to_goal[:, order], np.array(here)])
        model = LookModel(evidence[:, :, order], to_goal, apart, self._prices)
        now = Looking(0, len(order), left, tuple(belief.tolist()), 0)
        if self._simulations:
            rng = self._rng[i]
            search = Pomcp(model, self._simulations, EXPLORATION, DEPTH)
            cumulated = np.cumsum(belief)[:-1]
            action, _ = search.plan(
                lambda r: now._replace(truth=int(np.searchsorted(cumulated, r.random()))), rng
            )
        else:
            action = int(np.argmax([model.end(now, model.best_end(now)), *alone[order]]))
        if action == 0:
            return Drive(poses[model.best_end(now)], shares, task.goal, goal.towards, True, 0.0)
        target = looks.places[chosen[action - 1]]
        towards = CostToGo.of(building_field(site, target), site.lattice.table).towards
        late = left - LATE * first[order][action - 1] / self._prices.speed - SPARE
        return Drive(poses[0], shares, target, towards, False, late)

    def _by_odometry(self, simulation: Simulation, i: int, pose: Floats, at: Floats) -> Floats:
        """Return where points are for a robot at a pose, in the frame of odometry, shape (C, 2)."""
        points = np.column_stack([np.atleast_2d(at), np.zeros(len(np.atleast_2d(at)))])
        placed: Floats = compose(simulation.state["odometry"][i], between(pose, points))[:, :2]
        return placed

    def _seen_at(
        self, site: Site, costs: Any, poses: Floats, looks: Looks, places: Any
    ) -> tuple[Floats, Floats]:
        """Return evidence, shape (K, K, C), and metres to the goal, (K, C), at places."""
        count = len(poses)
        at = np.column_stack([looks.places[places], np.zeros(len(places))])
        offsets = between(poses[0], at)
        images = [at, *(compose(poses[k], offsets) for k in range(1, count))]
        scans = [looks.scans[places], *(scans_at(site, image) for image in images[1:])]
        evidence = np.zeros((count, count, len(places)))
        for j in range(count):
            for k in range(count):
                beams = (np.abs(scans[j] - scans[k]) > DIFFERENT).sum(axis=1)
                evidence[j, k] = np.minimum(EVIDENCE * beams, MOST)
        return evidence, np.array([_metres(site, costs, image[:, :2]) for image in images])


def _continued(drive: Drive | None, hypotheses: Floats) -> Drive | None:
    """Return the drive by the same hypothesis where that is now; None: a plan is due."""
    if drive is None or len(hypotheses) != len(drive.shares):
        return None
    off = np.hypot(*(hypotheses[:, 1:3] - drive.pose[:2]).T)
    nearest = int(np.argmin(off))
    changed = np.abs(np.sort(hypotheses[:, 0]) - np.sort(drive.shares)).max() > CHANGE
    if changed or off[nearest] > SAME:
        return None
    return drive._replace(pose=hypotheses[nearest, 1:])


def _metres(site: Site, costs: Any, points: Floats) -> Floats:
    """Return the metres that a cost to go says at points, shape (C,); 1000 where there is none."""
    metres = np.array([site.lattice.distance(costs, *point) for point in points.tolist()])
    return np.where(np.isfinite(metres), metres, 1e3)
