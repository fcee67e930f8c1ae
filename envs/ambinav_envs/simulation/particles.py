"""Monte Carlo localization of many robots: one kernel call for all in a building.

The filter is `ambinav.localization.mcl_update`, robot by robot: robot i is run i of one
`FilterState`, and draws from a generator of its own. What does not change is made once for each
building.
"""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.geometry.environment import Environment
from ambinav.localization.casting import CastTables
from ambinav.localization.filter_state import (
    FilterModel,
    FilterState,
    covariance_roots,
    filter_bytes,
    filter_model,
    filter_state,
    filter_tables,
)
from ambinav.localization.mcl_update import start_run, start_run_globally, update_run
from ambinav.localization.random import states
from ambinav.localization.scanner_settings import unsuited
from ambinav.runtime.array_types import Floats, Floats32, Ints, UInts
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.kernels import kernel
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.simulation.clusters import share_out, show_clusters

# Filters that take more bytes than this are refused.
MOST_BYTES = 8_000_000_000


class ParticleMap(NamedTuple):
    """The building data that particle filters read.

    Attributes:
        model: Map, scanner and parameters.
        cast: See `filter_tables`.
    """

    model: FilterModel
    cast: CastTables | None


def particle_map(environment: Environment, parameters: NavigationParameters) -> ParticleMap:
    """Prepare a building for particle filters.

    Warns:
        InputWarning: the model of the scan does not suit the scanner.

    Raises:
        InputError: the parameters of the filter are of no use here.
    """
    scanner, mcl = parameters.scanner, parameters.particles
    note = unsuited(mcl.laser_model_type, scanner)
    if note is not None:
        warnings.warn(note, InputWarning, stacklevel=2)
    try:
        model = filter_model(environment, scanner, mcl, None)
    except InputError as error:
        raise InputError(f"mcl: {error}") from error
    cast = filter_tables(environment, scanner, model)
    return ParticleMap(model, cast)


class ParticleFilters:
    """The filters of N robots.

    Args:
        parameters: Those of the filters among them.
        count: N.

    Attributes:
        state: The filters.
        clusters: The latest clusters, see `clusters.show_clusters`.

    Raises:
        InputError: they would not fit into memory.
    """

    def __init__(self, parameters: NavigationParameters, count: int) -> None:
        mcl = parameters.particles
        size = filter_bytes(mcl) * count
        if size > MOST_BYTES:
            raise InputError(
                f"mcl: max_particles is {mcl.max_particles}, which takes {size / 1e9:.1f} GB for "
                f"{count} robots; give fewer."
            )
        random = np.zeros((count, 4), dtype=np.uint64)
        self.state: FilterState = filter_state(mcl, count, random)
        # See `aliases.hypotheses`; of probability 0 where there are no more.
        self._starts = np.zeros((count, parameters.start_aliases + 1, 4))
        self.clusters = np.zeros((count, parameters.hypotheses, 4))
        # The latest K + 1 of them where they are seen K steps late, as in `layout.Memory`.
        self._late = np.zeros((parameters.late_steps + 1, *self.clusters.shape))

    def seed(self, i: int, stream: UInts) -> None:
        """Restart the random numbers of robot i from the words of a stream."""
        self.state.random[i] = states(np.random.Generator(np.random.PCG64(stream)), 1)[0]

    def expect(self, i: int, starts: Floats) -> None:
        """Set the starting poses of robot i, see `aliases.hypotheses`."""
        self._starts[i] = 0.0
        self._starts[i, : len(starts)] = starts

    def start(self, rows: Ints, robots: NDArray[np.void], site: ParticleMap) -> None:
        """Draw the particles of some robots from the mean and covariance of their records."""
        roots = covariance_roots(robots["covariance"][rows])
        _start(rows, robots, roots, site.model, self.state)

    def share_out(self, rows: Ints, site: ParticleMap) -> None:
        """Share the particles of some robots, which have just started, among those of `expect`."""
        share_out(rows, self._starts, site.model, self.state)

    def start_globally(self, rows: Ints, site: ParticleMap) -> None:
        """Draw the particles of some robots uniformly over the free space and all headings."""
        _start_globally(rows, site.model, self.state)

    def show(self, rows: Ints, robots: NDArray[np.void], out: Floats32) -> None:
        """Write the clusters of some robots, see `observations.HYPOTHESES`, shape (N, 4 K)."""
        show_clusters(rows, robots, self.state, self.clusters, self._late, out)

    def update(
        self, rows: Ints, robots: NDArray[np.void], readings: Floats, site: ParticleMap
    ) -> None:
        """Update some robots with odometry and readings, and write their estimates.

        Args:
            rows: Which robots.
            robots: See `layout.STATE`, shape (N,).
            readings: Shape (N, B), metres.
            site: The building that all of them are in.
        """
        _update(rows, robots, readings, site.model, site.cast, self.state)


@kernel
def _start(rows, robots, roots, model, filters):
    for k in range(rows.size):
        start_run(rows[k], robots[rows[k]].mean, roots[k], model, filters)


@kernel
def _start_globally(rows, model, filters):
    for k in range(rows.size):
        start_run_globally(rows[k], model, filters)


@kernel
def _update(rows, robots, readings, model, cast, filters):
    # In single precision, as `MonteCarloLocalizer.update` takes them.
    ranges = np.empty(readings.shape[1], dtype=np.float32)
    for k in range(rows.size):
        i = rows[k]
        robot = robots[i]
        for b in range(ranges.size):
            ranges[b] = readings[i, b]
        odometry = robot.odometry
        # Without a channel intensities are not looked at; with these types the code is that which
        # `MonteCarloLocalizer` has compiled.
        update_run(
            i, odometry[0], odometry[1], odometry[2], ranges, model, cast, filters, None, ranges
        )
        for m in range(3):
            robot.mean[m] = filters.mean[i, m]
            for n in range(3):
                robot.covariance[m, n] = filters.covariance[i, m, n]
