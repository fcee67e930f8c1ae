"""Starts that a scan does not tell from others: the pose, and where else the robot may be."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.geometry.frames import between, compose, wrap_angles
from ambinav.layers.aliasing.layer import aliased_poses
from ambinav.layers.aliasing.settle import settle
from ambinav.layers.context import LayerContext
from ambinav.localization.random import uniform
from ambinav.runtime.array_types import Bools, Floats, UInts
from ambinav_envs.buildings.building import Building
from ambinav_envs.buildings.free_space import MARGIN

# Poses whose aliases are looked for in a building: of more cells so many are drawn.
SOUGHT = 1500
# Likeness of an alias in the search and, better known, of one that is used.
SEARCHED, LIKE = 0.1, 0.5
# Distance between aliases, and of the goals that they lead to, from which they matter, metres.
APART = 3.0


@dataclass(frozen=True, eq=False)
class Aliases:
    """Aliased poses of a building, by cell of its map.

    Attributes:
        poses: Poses with at least one alias, shape (M, 3), metres and radians, map frame.
        alike: Their aliases, most alike first, shape (M, A, 3); NaN where there are no more.
        turns: Whether the scanner sees the same at any heading, so that those of the robot are any.
    """

    poses: Floats
    alike: Floats
    turns: bool

    @classmethod
    def of(cls, building: Building, count: int) -> Aliases:
        """Search a building's map.

        Args:
            building: The building.
            count: A, at least 1.
        """
        context = LayerContext.of(building.amap, building.environment, building.scanner)
        x, y = context.points
        stands = np.flatnonzero(_stands(building, x, y))
        sought = np.zeros(len(x), dtype=np.bool_)
        sought[np.random.default_rng(0).permutation(stands)[:SOUGHT]] = True
        matches = settle(
            context, aliased_poses(context, count, least=SEARCHED, sought=sought).poses
        )
        matches = matches[:, : 1 if context.turns_in_place else None]
        headings = context.headings[: matches.shape[1]]
        truth = np.empty((*matches.shape[:2], 3))
        truth[..., 0], truth[..., 1], truth[..., 2] = (x[:, None], y[:, None], headings)
        distance = np.hypot(
            matches[..., 0] - truth[..., None, 0], matches[..., 1] - truth[..., None, 1]
        )
        good = (matches[..., 3] >= LIKE) & (distance >= APART)
        # The turn becomes the heading there.
        poses = matches[..., :3] + truth[..., None, :] * (0.0, 0.0, 1.0)
        poses[~good] = np.nan
        # Good ones first.
        order = np.argsort(~good, axis=2, kind="stable")
        poses = np.take_along_axis(poses, order[..., None], axis=2)
        usable = good.any(axis=2)
        return cls(truth[usable], poses[usable], context.turns_in_place)

    def draw(self, state: UInts) -> Floats | None:
        """Draw a pose that has aliases, shape (3,); None if there is none.

        Args:
            state: State of the random numbers, uint64, shape (4,); advanced in place.
        """
        if not len(self.poses):
            return None
        pose: Floats = self.poses[int(uniform(state) * len(self.poses))].copy()
        if self.turns:
            pose[2] = math.pi * (2.0 * uniform(state) - 1.0)
        return pose

    def among(self, pose: Floats, goal: Floats) -> Floats | None:
        """Return the hypotheses of a robot at a pose: that pose, and its aliases.

        Args:
            pose: x, y, theta, shape (3,).
            goal: x, y, shape (2,). A robot that drove there by an alias would end `APART` from it
                or farther, or the alias is left out.

        Returns:
            Shape (H, 3) with H from 2 on; None where there is no alias.
        """
        if not len(self.poses):
            return None
        off = np.hypot(*(self.poses[:, :2] - pose[:2]).T)
        turn = 0.0 if self.turns else np.abs(wrap_angles(self.poses[:, 2] - pose[2]))
        nearest = int(np.argmin(off + turn))
        if off[nearest] > APART:
            return None
        alias = self.alike[nearest]
        # The same offset from the alias as from the cell.
        aliases = compose(alias, between(self.poses[nearest], pose))
        aliases[:, 2] = wrap_angles(aliases[:, 2])
        wrong = compose(pose, between(aliases, np.append(goal, 0.0)))
        far_aliases = aliases[np.hypot(*(wrong[:, :2] - goal).T) >= APART]
        return np.concatenate([pose[None], far_aliases]) if len(far_aliases) else None


def _stands(building: Building, x: Floats, y: Floats) -> Bools:
    """Return at which points the robot can stand, in the largest part of the building."""
    table = building.lattice.table
    rows, columns = table.room.shape
    column = np.rint((x - table.low_x) / table.spacing).astype(np.int64)
    row = np.rint((y - table.low_y) / table.spacing).astype(np.int64)
    inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
    cell = np.where(inside, row, 0), np.where(inside, column, 0)
    return np.asarray(inside & (table.labels[cell] == 0) & (table.room[cell] >= MARGIN))


def hypotheses(poses: Floats, prior: tuple[float, float], state: UInts) -> Floats:
    """Draw the prior probability of each of H poses, the first of which is the true one.

    That of one pose is drawn from `prior`, and the others share the rest equally. The one is drawn
    so that the true pose has a probability as often as that says.

    Args:
        poses: Shape (H, 3).
        prior: Least and greatest probability of the one.
        state: State of the random numbers, uint64, shape (4,); advanced in place.

    Returns:
        The poses and their probabilities, shape (H, 4).
    """
    count = len(poses)
    largest = prior[0] + (prior[1] - prior[0]) * uniform(state)
    favoured = 0 if uniform(state) < largest else 1 + int(uniform(state) * (count - 1))
    priors = np.full(count, (1.0 - largest) / (count - 1))
    priors[favoured] = largest
    return np.column_stack([poses, priors])
