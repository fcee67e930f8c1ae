"""Beams of a scanner as the ambiguity kernel needs them: limits, caps, deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ambinav.ambiguity.indistinguishability import FINE, FINEST_STD, evidence_table, most_evidence
from ambinav.runtime.array_types import Floats, Floats32, Indices, UInts
from ambinav.runtime.lanes import LANES
from ambinav.sensing.scanner import RangeScanner

TABLE = 1024
"""Ranges at which deviation and bias are tabulated."""


@dataclass(frozen=True, eq=False)
class BeamTable:
    """Properties of each beam that the kernels need.

    The columns are the ranges of B beams, then the intensities of K of them. `limit`, `inverse_cap`
    and `use` are padded from B + K columns to P, a multiple of `LANES`.

    Attributes:
        limit: Maximum range, metres, float32, shape (P,); of an intensity what none reaches.
        inverse_cap: 1 / (most evidence that the beam can give), float32, shape (P,).
        use: 1 for a beam and 0 for padding, float32, shape (P,).
        nearest: Minimum range, metres, float32, shape (B,).
        spread: float32, shape (B + K, TABLE): s^2 / 2 at ranges from 0 to the maximum, square
            metres.
        bias: float32, shape (B, TABLE): mean of reading minus true range, metres.
        width: Resolution by effective deviation at its widest, float64, shape (B + K,).
        intensity: Beam of each intensity column, shape (K,), ascending.
        surface: For each of these the mean reading of a wall and of a reflector, half the variance
            and the nearest range that has one, metres; float32, shape (K, 4).
    """

    limit: Floats32
    inverse_cap: Floats32
    use: Floats32
    nearest: Floats32
    spread: Floats32
    bias: Floats32
    width: Floats
    intensity: Indices = field(default_factory=lambda: np.empty(0, dtype=np.intp))
    surface: Floats32 = field(default_factory=lambda: np.empty((0, 4), dtype=np.float32))

    @classmethod
    def of(
        cls, scanner: RangeScanner, map_std: float, outlier_share: float, reflectors: bool = False
    ) -> BeamTable:
        """Tabulate the scanner's sensors, beam by beam.

        Args:
            scanner: The scanner.
            map_std: Standard deviation of the walls' position, metres.
            outlier_share: Share of beams that meet what is not on the map.
            reflectors: Whether the building has any. Only then are there intensity columns: where
                all is wall they tell nothing, and would cost as much as the ranges.
        """
        limit, cap, nearest, spread, bias, width = [], [], [], [], [], []
        for sensor in scanner.sensors:
            ranges = np.linspace(0.0, sensor.max_range, TABLE)
            squared = sensor.std_at(ranges) ** 2 + sensor.resolution**2 / 12.0 + map_std**2
            squared = np.maximum(squared, FINEST_STD**2)
            finest = math.sqrt(float(squared.min()))
            odd = min(outlier_share + sensor.random_share + sensor.lost_share, 0.99)
            limit.append(sensor.max_range)
            cap.append((1.0 / most_evidence(odd, finest), -1.0 / math.log(odd)))
            nearest.append(sensor.min_range)
            spread.append(squared / 2.0)
            bias.append(sensor.bias_at(ranges))
            width.append(sensor.resolution / finest)
        beam = scanner.sensor_of_beam
        intensity_beams = scanner.intensity_beams if reflectors else np.empty(0, dtype=np.intp)
        surface = _surfaces(scanner, intensity_beams)
        count = len(beam) + len(intensity_beams)
        padding = (0, -count % LANES)
        caps = np.array(cap, dtype=np.float32)
        # Twice the brightest: no reading counts as out of range.
        limits = np.concatenate([np.array(limit, dtype=np.float32)[beam], 2.0 * surface[:, 1]])
        flat = np.repeat(surface[:, 2:3], TABLE, axis=1)
        return cls(
            np.pad(limits, padding, constant_values=1.0),
            np.pad(np.concatenate([caps[beam, 0], caps[beam[intensity_beams], 1]]), padding),
            np.pad(np.ones(count, dtype=np.float32), padding),
            np.array(nearest, dtype=np.float32)[beam],
            np.concatenate([np.array(spread, dtype=np.float32)[beam], flat]),
            np.array(bias, dtype=np.float32)[beam],
            np.concatenate([np.array(width)[beam], np.zeros(len(intensity_beams))]),
            intensity_beams,
            surface,
        )

    @property
    def beams(self) -> int:
        """Number of beams B."""
        return len(self.nearest)

    @property
    def columns(self) -> int:
        """Number of columns B + K."""
        return self.beams + len(self.intensity)

    def turned(self, beams: UInts) -> UInts:
        """Return the column of each column in turns of the robot, shape (n, B + K).

        `beams` gives it for the beams, shape (n, B).

        An intensity goes where its beam goes.
        """
        if not len(self.intensity):
            return beams
        to = np.searchsorted(self.intensity, beams[:, self.intensity]) + self.beams
        return np.concatenate([beams, to.astype(beams.dtype)], axis=1)

    def columns_of(self, beams: Sequence[int] | Indices) -> Indices:
        """Return columns of some beams, in order: the ranges, then the intensities they read."""
        chosen = np.asarray(beams, dtype=np.intp)
        with_intensity = chosen[np.isin(chosen, self.intensity)]
        return np.concatenate(
            [chosen, np.searchsorted(self.intensity, with_intensity) + self.beams]
        )

    def subset(self, beams: Sequence[int] | Indices) -> BeamTable:
        """Return the table of some beams, in order, as for a scanner with only these.

        What they return stands in `columns_of` the same beams.
        """
        chosen = np.asarray(beams, dtype=np.intp)
        columns = self.columns_of(chosen)
        padding = (0, -len(columns) % LANES)
        return BeamTable(
            np.pad(self.limit[columns], padding, constant_values=1.0),
            np.pad(self.inverse_cap[columns], padding),
            np.pad(self.use[columns], padding),
            self.nearest[chosen],
            self.spread[columns],
            self.bias[chosen],
            self.width[columns],
            np.flatnonzero(np.isin(chosen, self.intensity)),
            self.surface[columns[len(chosen) :] - self.beams],
        )

    @cached_property
    def evidence(self) -> Floats32 | None:
        """`evidence_table` of each beam, float32, (P, Z), or None where all bins are fine."""
        if self.width.max() <= FINE:
            return None
        widths, beam = np.unique(self.width, return_inverse=True)
        rows = np.pad(beam, (0, len(self.limit) - len(beam)))
        return np.asarray(evidence_table(widths)[rows])


def _surfaces(scanner: RangeScanner, beams: Indices) -> Floats32:
    """Return the values of `BeamTable.surface`."""
    rows = []
    for sensor in (scanner.sensors[i] for i in scanner.sensor_of_beam[beams]):
        channel = sensor.intensity
        assert channel is not None  # of `intensity_beams`
        nearest = max(channel.min_range, sensor.min_range)
        rows.append((channel.wall, channel.reflector, channel.std**2 / 2.0, nearest))
    return np.array(rows, dtype=np.float32).reshape(-1, 4)
