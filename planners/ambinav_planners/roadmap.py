"""OMPL's PRM*, grown as a roadmap and searched separately: one roadmap serves every weight."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from ompl import base as ob
from ompl import geometric as og

from ambinav.runtime.array_types import Floats, Ints32
from ambinav_planners.ompl_setup import Setup, prepare
from ambinav_planners.problem import Problem
from ambinav_planners.registry import Budget, Planner, PlannerResult
from ambinav_planners.sampler import FreeSampler
from ambinav_planners.search.cheapest import cheapest_on
from ambinav_planners.search.graph import MotionGraph
from ambinav_planners.spaces import pose_reader
from ambinav_planners.validator import Unchecked

# Milestones of the first roadmap; each next one has as many times more.
FIRST_MILESTONES = 1000
GROWTH = 4.0
# The milestones after which more would not fit into memory.
MAX_MILESTONES = 100_000
# Share of the time for growing a single roadmap.
GROWING_SHARE = 0.25
# Part of the time left that the next roadmap may be expected to take.
CAUTION = 0.6
# Blocks of samples without a free pose after which there is taken to be none.
BLOCKED = 100


@dataclass(eq=False)
class Roadmap:
    """A growing PRM* over a problem's free space.

    OMPL asks `FreeSampler` for milestones and decides which of them to join, e (1 + 1/d) log n
    neighbours each (Karaman and Frazzoli 2011); whether the motions are free and what they cost is
    found out for all of them at once. `solve` is not used: with an objective in Python it
    deadlocks.
    """

    problem: Problem
    _setup: Setup
    _planner: og.PRMstar
    _samplers: list[FreeSampler]

    @classmethod
    def over(cls, problem: Problem, seed: int | None = None) -> Roadmap:
        """Create an empty roadmap; the seed is that of its milestones."""
        setup = prepare(problem, Unchecked)
        rng = np.random.default_rng(seed)
        samplers: list[FreeSampler] = []

        def allocate(si: ob.SpaceInformation) -> FreeSampler:
            samplers.append(FreeSampler(si, problem, rng))
            return samplers[-1]

        setup.si.setValidStateSamplerAllocator(allocate)
        planner = og.PRMstar(setup.si)
        setup.simple.setPlanner(planner)
        setup.simple.setup()
        return cls(problem, setup, planner, samplers)

    @property
    def milestones(self) -> int:
        """Number of milestones."""
        return int(self._planner.milestoneCount())

    def grow(self, milestones: int, until: float = math.inf) -> None:
        """Grow to a number of milestones, or until a time of `time.perf_counter`.

        Where hardly any pose is free it ends earlier.
        """

        def stop() -> bool:
            is_blocked = any(sampler.failed >= BLOCKED for sampler in self._samplers)
            return bool(is_blocked or self.milestones >= milestones or time.perf_counter() >= until)

        self._planner.growRoadmapPtc(ob.PlannerTerminationCondition(stop))

    def graph(self) -> MotionGraph:
        """Return its free motions; start and goal are the last two nodes."""
        data = ob.PlannerData(self._setup.si)
        self._planner.getPlannerData(data)
        read = pose_reader(self.problem.steering.space != "r2")
        count = data.numVertices()
        # No milestone at all is a roadmap as well.
        poses = np.array([read(data.getVertex(i).getState()) for i in range(count)]).reshape(-1, 3)
        neighbours = [data.getEdges(i) for i in range(count)]
        degree = np.array([len(row) for row in neighbours], dtype=np.int64)
        source = np.repeat(np.arange(count), degree)
        target = np.array([neighbour for row in neighbours for neighbour in row], dtype=np.int64)
        pairs = np.stack([source, target], axis=-1)[source < target].astype(np.int32)
        return MotionGraph.of_motions(
            np.concatenate([poses, self.problem.ends]),
            np.concatenate([pairs, self._ends(poses)]),
            self.problem.service,
            self.problem.checker,
        )

    def _ends(self, poses: Floats) -> Ints32:
        """Return pairs that join start and goal to their nearest milestones, and to each other."""
        count = len(poses)
        pairs = [np.array([[count, count + 1]])]
        neighbour_count = max(1, math.ceil(2.0 * math.e * 1.5 * math.log(count + 1)))
        for k, end in enumerate(self.problem.ends):
            distance = np.hypot(poses[:, 0] - end[0], poses[:, 1] - end[1])
            near = np.argsort(distance, kind="stable")[:neighbour_count]
            pairs.append(np.stack([near, np.full(len(near), count + k)], axis=-1))
        return np.concatenate(pairs).astype(np.int32)


def grown_graph(problem: Problem, budget: Budget) -> MotionGraph:
    """Grow one roadmap about as large as the budget allows; start and goal are its last nodes.

    Reading and checking it takes about three times as long as growing it.
    """
    roadmap = Roadmap.over(problem, budget.seed)
    max_milestones = MAX_MILESTONES if budget.iterations is None else budget.iterations
    roadmap.grow(max_milestones, time.perf_counter() + GROWING_SHARE * budget.seconds)
    return roadmap.graph()


def solve_roadmap(problem: Problem, budget: Budget) -> PlannerResult:
    """Grow and search repeatedly, as long as the next roadmap fits into the time.

    A budget of iterations is the number of milestones of one single roadmap.
    """
    started = time.perf_counter()
    until = started + budget.seconds
    roadmap = Roadmap.over(problem, budget.seed)
    milestones = FIRST_MILESTONES if budget.iterations is None else budget.iterations
    best: Floats | None = None
    curve: list[tuple[float, float]] = []
    while True:
        begun = time.perf_counter()
        roadmap.grow(milestones, until)
        poses = cheapest_on(roadmap.graph(), problem)
        now = time.perf_counter()
        if poses is not None:
            cost = problem.service.route_cost(poses, problem.steering)
            if not curve or cost < curve[-1][1]:
                best = poses
                curve.append((now - started, cost))
        if budget.iterations is not None or roadmap.milestones == 0:
            return PlannerResult(best, tuple(curve), roadmap.milestones)
        each = (now - begun) / roadmap.milestones
        fits = int((until - now) * CAUTION / each)  # neighbours grow with the logarithm as well
        milestones = min(int(GROWTH * roadmap.milestones), fits, MAX_MILESTONES)
        # A roadmap that is hardly larger is not worth its time.
        if milestones < 1.5 * roadmap.milestones:
            return PlannerResult(best, tuple(curve), roadmap.milestones)


PRMSTAR = Planner(
    "prmstar",
    solve_roadmap,
    "PRM* grown as a roadmap and searched apart (Karaman and Frazzoli 2011)",
    iteration="milestones",
    keeps_limit=True,
)
