"""Free space of a building for a robot, and distances in it to a goal."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.collision.sweep import line_free
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import Lattice
from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32, Ints, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.service.field import Field
from ambinav_envs.buildings.geodesic import LENGTHS, SIDES, STEPS, distance_at

SPACING = 0.2
"""Distance between the cells, metres, for robots that are no smaller than that asks for."""
# The nearest cell to a robot must lie within its disc, so that no wall is between them; down to
# robots of this radius, metres.
SMALLEST_RADIUS = 0.05
MARGIN = 0.05
"""Room around a robot at its start and its goal, metres."""


class FreeSpaceArrays(NamedTuple):
    """The arrays of `FreeSpaceLattice` for the kernels.

    Attributes:
        room: See `FreeSpaceLattice`, as the next three.
        moves: See there.
        links: See there.
        labels: See there.
        standing: See there.
        prices: Price of a metre at each cell, see `geodesic`; float32, shape (rows, columns, H).
        low_x: x of the centre of cell (0, 0), metres.
        low_y: y of it.
        spacing: Distance between cells, metres.
        walls: First of `CollisionChecker.arrays`.
        bound: The second.
        forbidden: The third.
    """

    room: Floats32
    moves: NDArray[np.uint16]
    links: Bytes
    labels: Ints32
    standing: Ints
    prices: Floats32
    low_x: float
    low_y: float
    spacing: float
    walls: Floats
    bound: Floats32
    forbidden: Bools


@dataclass(frozen=True, eq=False)
class FreeSpaceLattice:
    """The cells of a lattice over the free space, and the moves between cells where the robot fits.

    Attributes:
        checker: Collision checker of the robot's disc in the building, for straight motions (r2).
        origin: x and y of the centre of cell (0, 0), metres, map frame.
        spacing: Distance between cells, metres.
        room: Metres from the robot's disc at each cell to the nearest wall, float32, shape
            (rows, columns); negative where the robot does not fit.
        moves: Moves of the robot, see `geodesic`; uint16, shape (rows, columns). Between cells
            where it fits they are exactly those that its disc gets along; from there they lead
            on into what is nearer to a wall, so that every point has a distance.
        links: See `geodesic`; uint8, shape (rows, columns).
        labels: Which cells where the robot fits are connected, int32, shape (rows, columns), from
            0 on, the most cells first; -1 where it does not fit.
    """

    checker: CollisionChecker
    origin: tuple[float, float]
    spacing: float
    room: Floats32
    moves: NDArray[np.uint16]
    links: Bytes
    labels: Ints32

    @classmethod
    def of(cls, checker: CollisionChecker, spacing: float | None = None) -> FreeSpaceLattice:
        """Build the lattice of a building.

        Args:
            checker: Collision checker of the robot's disc, for straight motions (r2).
            spacing: Metres; None: `SPACING`, or less for a robot of less than 0.14 m of radius.

        Raises:
            InputError: the robot fits at no cell of it.
        """
        radius = checker.footprint.outer
        if spacing is None:
            spacing = min(SPACING, math.sqrt(2.0) * max(radius, SMALLEST_RADIUS))
        return cls._on(checker, Lattice.over(checker.environment, spacing))

    def like(self, checker: CollisionChecker) -> FreeSpaceLattice:
        """Build a lattice with the same cells for a variant of this building.

        Raises:
            InputError: the robot fits at no cell of it.
        """
        rows, columns = self.room.shape
        x = self.origin[0] + self.spacing * np.arange(columns, dtype=np.float64)
        y = self.origin[1] + self.spacing * np.arange(rows, dtype=np.float64)
        across, up = np.meshgrid(x, y)
        inside = checker.environment.triangulation.contains(across.ravel(), up.ravel())
        free = inside.reshape(self.room.shape)
        return self._on(checker, Lattice(checker.environment, self.spacing, x, y, free))

    @classmethod
    def _on(cls, checker: CollisionChecker, lattice: Lattice) -> FreeSpaceLattice:
        environment, radius = checker.environment, checker.footprint.outer
        spacing = lattice.spacing
        links = np.zeros(lattice.free.shape, dtype=np.uint8)
        links[lattice.free] = lattice.links
        room = np.full(links.shape, -1.0, dtype=np.float32)
        # Clearances above the longest step make no difference.
        room[lattice.free] = lattice.clearance(radius + 3.0 * spacing) - radius
        if not (room >= 0.0).any():
            raise InputError(
                f"{_called(environment)} has no room for a robot of {radius:g} m of radius: it "
                f"fits at no point of a lattice of {spacing:g} m; take a smaller robot or another "
                "map."
            )
        moves = np.zeros(links.shape, dtype=np.uint16)
        origin = float(lattice.x[0]), float(lattice.y[0])
        run_rows(_join, len(room), room, links, spacing, *origin, *checker.arrays, moves)
        return cls(checker, origin, spacing, room, moves, links, _labels(room >= 0.0, moves))

    @property
    def free(self) -> Bools:
        """Cells where the robot fits, shape (rows, columns)."""
        return np.asarray(self.room >= 0.0)

    @property
    def name(self) -> str:
        """Name of the building in messages."""
        return _called(self.checker.environment)

    @property
    def frame(self) -> tuple[float, float, float]:
        """Last arguments of `distance_at`: x and y of cell (0, 0), and cells per metre."""
        return (*self.origin, 1.0 / self.spacing)

    @cached_property
    def standing(self) -> Ints:
        """Indices (row * columns + column) of the cells with clearance `MARGIN` to spare, int64."""
        return np.flatnonzero(self.room >= MARGIN)

    @cached_property
    def table(self) -> FreeSpaceArrays:
        """All arrays for the kernels; a metre costs 1 everywhere."""
        walls, bound, forbidden = self.checker.arrays
        prices = np.ones((*self.room.shape, 1), dtype=np.float32)
        return FreeSpaceArrays(
            self.room, self.moves, self.links, self.labels, self.standing, prices, *self.origin,
            self.spacing, walls, bound, forbidden,
        )  # fmt: skip

    def prices(self, ambiguity: Field, weight: float) -> Floats32:
        """Return the cost of a metre at each cell: 1 + weight * ambiguity; see `geodesic`."""
        rows, columns = self.room.shape
        x = self.origin[0] + self.spacing * np.arange(columns)
        y = self.origin[1] + self.spacing * np.arange(rows)
        return np.asarray(1.0 + weight * ambiguity.on(x, y), dtype=np.float32)

    def distance(self, field: Floats32, x: float, y: float) -> float:
        """Return the cost to go from (x, y), read from a field of `geodesic`."""
        return float(distance_at(x, y, field, self.links, *self.frame))


def _called(environment: Environment) -> str:
    return environment.name if environment.source is None else str(environment.source)


def _labels(free: Bools, moves: NDArray[np.uint16]) -> Ints32:
    """Return the component of each free cell, the largest component first; -1 elsewhere."""
    labels = np.full(free.shape, -1, dtype=np.int32)
    _flood(free.ravel(), moves.ravel(), free.shape[1], labels.ravel())
    counts = np.bincount(labels[free])
    rank = np.empty(len(counts), dtype=np.int32)
    rank[np.argsort(-counts, kind="stable")] = np.arange(len(counts))
    labels[free] = rank[labels[free]]
    return labels


@kernel
def _flood(free, moves, columns, labels):
    """Number the components of the free cells in the order of their first cells."""
    stack = np.empty(free.size, dtype=np.int32)
    part = 0
    for first in range(free.size):
        if not free[first] or labels[first] >= 0:
            continue
        labels[first], stack[0], height = part, first, 1
        while height > 0:
            height -= 1
            cell = np.int64(stack[height])
            for k in range(STEPS.shape[0]):
                if moves[cell] & (1 << k):
                    other = cell + STEPS[k, 1] * columns + STEPS[k, 0]
                    if free[other] and labels[other] < 0:
                        labels[other], stack[height] = part, other
                        height += 1
        part += 1


@kernel
def _join(low, high, room, links, spacing, low_x, low_y, table, bound, forbidden, moves):
    """Write `FreeSpaceLattice.moves`."""
    rows, columns = room.shape
    for row in range(low, high):
        for column in range(columns):
            here = room[row, column]
            x, y = low_x + column * spacing, low_y + row * spacing
            bits = 0
            for k in range(STEPS.shape[0]):
                c, r = column + STEPS[k, 0], row + STEPS[k, 1]
                if c < 0 or r < 0 or c >= columns or r >= rows:
                    continue
                there = room[r, c]
                if there < 0.0:
                    # Only cells in the free space are linked.
                    joined = k < SIDES and links[row, column] & (1 << k) != 0
                elif here < 0.0:
                    joined = False
                else:
                    # The step's clearance is at least the mean of both ends' less half its length.
                    joined = here + there >= LENGTHS[k] * spacing or line_free(
                        x, y, low_x + c * spacing, low_y + r * spacing, table, bound, forbidden
                    )
                if joined:
                    bits |= 1 << k
            moves[row, column] = bits
