"""Monte Carlo tree search over histories, for any generative model.

POMCP of Silver and Veness, "Monte-Carlo planning in large POMDPs" (2010).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

import numpy as np

S = TypeVar("S")


class Generative(Protocol[S]):
    """A POMDP that can be sampled. Rewards are undiscounted; time is priced by them."""

    def actions(self, state: S) -> Sequence[int]:
        """Return what can be done; states of one history have the same actions."""

    def step(
        self, state: S, action: int, rng: np.random.Generator
    ) -> tuple[S | None, Hashable, float]:
        """Sample the next state, None at the end, what is observed, and the reward."""

    def rollout(self, state: S, rng: np.random.Generator) -> float:
        """Sample the sum of rewards of a policy that depends on the history alone."""


@dataclass
class Branch:
    """An action at a history.

    Attributes:
        visits: Number of simulations that took it.
        value: Mean of their rewards from there on.
        after: The histories that follow, by observation.
    """

    visits: int = 0
    value: float = 0.0
    after: dict[Hashable, Node] = field(default_factory=dict)


@dataclass
class Node:
    """A history.

    Attributes:
        visits: Number of simulations that took one of its actions.
        branches: Its actions.
    """

    visits: int = 0
    branches: dict[int, Branch] = field(default_factory=dict)


@dataclass(frozen=True)
class Pomcp(Generic[S]):
    """Plans by simulations from sampled states.

    Attributes:
        model: The POMDP.
        simulations: Number of them for a plan.
        exploration: Weight c of the bound of UCB1, V + c sqrt(log N / n), in units of reward.
        depth: Number of actions after which a history is valued by a rollout.
    """

    model: Generative[S]
    simulations: int
    exploration: float
    depth: int

    def plan(
        self, draw: Callable[[np.random.Generator], S], rng: np.random.Generator
    ) -> tuple[int, float]:
        """Return the best first action and its value.

        Args:
            draw: Draws a state from the present belief, such as a particle.
            rng: Source of randomness.
        """
        root = Node()
        for _ in range(self.simulations):
            self._simulate(draw(rng), root, self.depth, rng)
        best = max(root.branches, key=lambda action: root.branches[action].value)
        return best, root.branches[best].value

    def _simulate(self, state: S, node: Node, depth: int, rng: np.random.Generator) -> float:
        if not node.branches:
            node.branches = {action: Branch() for action in self.model.actions(state)}
        action = self._choose(node)
        branch = node.branches[action]
        following, seen, total = self.model.step(state, action, rng)
        if following is not None:
            known = branch.after.get(seen)
            if depth > 1 and known is not None:
                total += self._simulate(following, known, depth - 1, rng)
            else:
                branch.after.setdefault(seen, Node())
                total += self.model.rollout(following, rng)
        node.visits += 1
        branch.visits += 1
        branch.value += (total - branch.value) / branch.visits
        return total

    def _choose(self, node: Node) -> int:
        log = math.log(node.visits + 1)
        best, highest = -1, -math.inf
        for action, branch in node.branches.items():
            if branch.visits == 0:
                return action
            bound = branch.value + self.exploration * math.sqrt(log / branch.visits)
            if bound > highest:
                best, highest = action, bound
        return best
