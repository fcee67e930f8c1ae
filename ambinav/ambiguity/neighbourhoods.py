"""Poses of a lattice with their neighbours, for ambiguity without a whole map."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.kernel import neighbourhood_sums
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.geometry.lattice import Lattice
from ambinav.runtime.array_types import Bools, Bytes, Floats, Floats32, Ints


def disc(radius: float, spacing: float) -> Ints:
    """Return row and column steps to the points within `radius` metres, int64, shape (K, 2)."""
    reach = math.floor(radius / spacing + 1e-9)
    steps = np.arange(-reach, reach + 1)
    rows, columns = (axis.ravel() for axis in np.meshgrid(steps, steps, indexing="ij"))
    near = (rows**2 + columns**2) * spacing**2 <= radius**2 * (1 + 1e-9)
    return np.stack([rows[near], columns[near]], axis=1)


def points_near(lattice: Lattice, chosen: Bools, radius: float) -> Bools:
    """Return the mask of points within `radius` metres of a point of the mask `chosen`, (N,)."""
    rows, columns = lattice.rows_columns[chosen].T
    near = np.zeros_like(lattice.free)
    for row, column in disc(radius, lattice.spacing):
        r, c = rows + row, columns + column
        inside = (r >= 0) & (c >= 0) & (r < near.shape[0]) & (c < near.shape[1])
        near[r[inside], c[inside]] = True
    return np.asarray(near[lattice.free])


@dataclass(frozen=True, eq=False)
class Neighbourhoods:
    """M poses of a lattice, and the N poses, these included, that they are compared with.

    Attributes:
        lattice: The N poses, no others.
        among: Running numbers of the N poses in the lattice that they were taken from, int64, (N,).
        poses: Running numbers of the M poses in `lattice`, int64, ascending, shape (M,).
        possible: Whether the robot can stand at the N poses at each of H headings, shape (N, H).
        links: `Lattice.links_among` what is possible, uint8, shape (H, N).
        radius: Radius of the neighbourhoods, metres.
    """

    lattice: Lattice
    among: Ints
    poses: Ints
    possible: Bools
    links: Bytes
    radius: float

    @classmethod
    def around(
        cls, lattice: Lattice, possible: Bools, chosen: Bools, radius: float
    ) -> Neighbourhoods:
        """Take the chosen points of a lattice, and the points within `radius` metres of them.

        Args:
            lattice: N free points, as `standing_lattice` gives them.
            possible: Whether the robot can stand there, shape (N, H).
            chosen: Mask of the points that are wanted, shape (N,).
            radius: Radius of the neighbourhoods, metres.
        """
        needed = points_near(lattice, chosen, radius)
        links = [lattice.links_among(needed & here)[needed] for here in possible.T]
        return cls(
            lattice.among(needed),
            np.flatnonzero(needed),
            np.flatnonzero(chosen[needed]),
            possible[needed],
            np.stack(links),
            radius,
        )

    @cached_property
    def offsets(self) -> Ints:
        """Steps to the neighbours of a pose: see `disc`."""
        return disc(self.radius, self.lattice.spacing)

    def sums(self, data: Floats32, table: BeamTable, model: AmbiguityModel) -> Floats:
        """Compute `neighbourhood_sums` for the M poses; nan where one is impossible.

        Args:
            data: Returns of the N poses at the H headings, float32, shape (H, N, 5, P): see
                `Returns`. Columns of it that are copied out are a scanner of fewer beams.
            table: Its P beams, padding included.
            model: The parameters; its radius is not read.

        Returns:
            float64, shape (M, H, 7).
        """
        spacing = self.lattice.spacing
        sums = neighbourhood_sums(
            self.poses, 0, self.lattice.rows_columns, self.lattice.index, self.links, self.offsets,
            spacing, data, table, table.evidence, model.tau, model.cell_variance(spacing),
        )  # fmt: skip
        sums[~self.possible[self.poses]] = np.nan
        return sums
