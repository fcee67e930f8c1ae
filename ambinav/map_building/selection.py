"""Ambiguity at some poses of a lattice: others nearby are scanned, but not computed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.dataset import LatticeSums
from ambinav.ambiguity.heading import turning_moments, turns
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.neighbourhoods import Neighbourhoods, disc
from ambinav.ambiguity.returns import Returns, blind_share, panorama_returns
from ambinav.geometry.lattice import Lattice
from ambinav.map_building.build import tiled
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.arrays import line_of_floats
from ambinav.runtime.progress import Progress
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True, eq=False)
class ChosenPoses:
    """Settings with which poses are computed.

    Attributes:
        scanner: The beams that take part.
        table: These, tabulated.
        model: The parameters.
        headings: Radians, shape (H,).
        turning: Whether the map tells how far the robot can turn unseen.
    """

    scanner: RangeScanner
    table: BeamTable
    model: AmbiguityModel
    headings: Floats
    turning: bool

    def sums(
        self, lattice: Lattice, possible: Bools, chosen: Bools, report: Progress
    ) -> LatticeSums:
        """Compute the chosen poses, with the same results as `build_map`, bit for bit.

        Args:
            lattice: N free points: the chosen ones and all within the radius of these.
            possible: Whether the robot can stand there, shape (N, H).
            chosen: Bools of the M points that are wanted, shape (N,).
            report: Called with the share done.

        Returns:
            Of the M points.
        """
        steps = int(disc(self.model.radius, lattice.spacing).max())
        headings, count = len(self.headings), int(chosen.sum())
        results = LatticeSums(
            np.empty((count, headings, 7)),
            np.empty(count),
            np.empty((count, 2)) if self.turning else None,
        )
        done = 0
        # Used again for each band: it takes the system as long to hand out pages as to fill them.
        room = np.empty(0, dtype=np.float32)
        for band in tiled(lattice, steps, headings * 5 * len(self.table.limit) * 4):
            in_band = np.zeros_like(chosen)
            in_band[band.begin : band.end] = chosen[band.begin : band.end]
            added = int(in_band.sum())
            if added:
                part = Neighbourhoods.around(lattice, possible, in_band, self.model.radius)
                shape = headings, len(part.lattice.points[0]), 5, len(self.table.limit)
                if room.size < math.prod(shape):
                    room = line_of_floats(math.prod(shape))
                data = room[: math.prod(shape)].reshape(shape)
                self._fill(part, data, results, slice(done, done + added))
                done += added
                report(done / count)
        return results

    def _fill(
        self, part: Neighbourhoods, data: Floats32, results: LatticeSums, where: slice
    ) -> None:
        scanner, table, headings = self.scanner, self.table, self.headings
        x, y = part.lattice.points
        building = part.lattice.environment
        panorama_returns(building, scanner, table, x, y, headings, data)
        results.sums[where] = part.sums(data, table, self.model)
        if results.turning is not None:
            results.turning[where] = turning_moments(
                Returns(data[0]), part.poses, turns(scanner), table, table.evidence,
                self.model.tau, part.lattice.spacing,
            )  # fmt: skip
        blind = blind_share(data, 0, len(x), table.beams)[part.poses]
        results.unknown[where] = blind.mean(axis=1, where=part.possible[part.poses])
