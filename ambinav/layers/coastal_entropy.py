"""Expected entropy of the pose after a scan: coastal navigation.

Source: after N. Roy, W. Burgard, D. Fox and S. Thrun, "Coastal navigation: mobile robot navigation
with uncertainty in dynamic environments", ICRA 1999: the robot keeps to where a scan is expected to
leave the least entropy of its pose, E_s[H(pose | scan s)], in a building where people block
beams. The paper itself was not at hand; all that follows is our own reading.

Before the scan the robot is as probably in one cell of the neighbourhood as in another: the free
cells within the map's radius R that free steps between possible poses lead to. Readings r_i make
the cell q as probable as

    b(q) ~ integral over q's cell of exp(-sum_i rho(z_i) / tau),   z_i = (r_i - d_i(q)) / s_i,
    rho(z) = -log((1 - e) exp(-z^2 / 2) + f),   f = e s sqrt(2 pi) / (maximum - minimum range).

e is the share of beams that meet what is not on the map (the model's `outlier_share`, with the
sensor's random and lost readings). exp(-z^2 / 2) is the likelihood of a noisy reading at a known
pose, relative to its peak 1 / (s sqrt(2 pi)), at the s of the most precise reading. An odd reading
falls anywhere in the sensor's range, with the density e / (maximum - minimum range), which relative
to that peak is f. Hence rho ends at -log f, 5 to 6 where e is 5 to 10 %. The cap of the model's own
indistinguishability I(p, q), -log e, is wary of maps; a posterior under it is not Bayes', for odd
readings would be as dense everywhere as explained ones at their peak.

The readings are those at p, with their noise n and their odd beams. What a beam tells of q against
p is, in the mean of both,

    E[rho(n + z) - rho(n)] = (1 - e) (k z^2 / 2 for small z, -log f - E[rho(n)] for large ones),

k = E[rho''(n)] (`expected_evidence`): noise alone uses up some of what a capped beam can tell. The
integral over a cell then is that of I (docs/model.md), with evidence and cap of this size, over
each quarter of the cell where the robot can stand: beside rough walls scans are not linear over a
whole one. The weight within a quarter is that of a point anywhere in it, 1/12 of its squared edge,
not the h^2 / 4 of the tensor, whose overlapping cells would leave nearly 2 bits where the pose is
known exactly. Noise also moves the whole posterior, by a Gaussian as wide as itself: the entropy
of its cells is the mean over that, by a rule of seven points that is exact to the fifth order. To
move the posterior against the cells is in closed form, so no beam is compared twice. Then

    H(p) = E[- sum_q b(q) log2 b(q)]   bits, from 0 to log2 of the number of cells,

which rises by 2 bits where the spacing is halved and nothing else changes. `coastal_entropy_gain`
is that number of bits less H: what the scan tells.

People stand anywhere with the same probability, so a beam meets one within each metre with the
same chance and comes through d metres with exp(-people d). A beam that is blocked tells nothing of
the pose; its evidence counts with the probability that it is not.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.feasible_poses import can_stand
from ambinav.ambiguity.gaussian import FAST
from ambinav.ambiguity.indistinguishability import FINE, Z_MAX, Z_STEP, evidence
from ambinav.ambiguity.neighbourhoods import disc
from ambinav.ambiguity.pair import compare
from ambinav.ambiguity.reach import reach
from ambinav.ambiguity.returns import beam_returns
from ambinav.config import as_nonnegative
from ambinav.geometry.lattice import STEPS
from ambinav.layers.bands import bands
from ambinav.layers.context import LayerContext
from ambinav.layers.registry import Layer
from ambinav.runtime.array_types import Bytes, Floats, Floats32, Ints, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

# People met by a beam in a metre: one in 20 m, a corridor with somebody in it.
PEOPLE = 0.05
# Nobody sees past so many people in the mean: e^-20 of the evidence is nothing.
CROWD = np.float32(20.0)
# Squared edge over the variance of a point that is anywhere in a square.
SQUARE = 12.0
# A cell is compared by its quarters: scans of rough walls are linear over 5 cm, but not over 10.
QUARTERS = np.array([(-0.25, -0.25), (-0.25, 0.25), (0.25, -0.25), (0.25, 0.25)])
# Noise that a normal distribution is integrated over, in deviations, for `expected_evidence`.
NOISE = np.linspace(-10.0, 10.0, 4001)
# The rule for means over a normal distribution of the plane: its middle, and six points around.
SHIFTS = np.array(
    [(0.0, 0.0), *((2 * math.cos(k), 2 * math.sin(k)) for k in math.pi / 3 * np.arange(6))]
)
WEIGHTS = np.array([1 / 2, *[1 / 12] * 6])


class Neighbourhood(NamedTuple):
    """Cells around the poses from `first` on; see `kernel.neighbourhood_sums`.

    Attributes:
        first: Running number of the first pose in `links` and `rows`.
        rows_columns: See `Lattice`.
        running: See `Lattice.index`.
        links: See `Lattice`.
        steps: To the eight neighbours of a cell.
        offsets: Row and column steps of the disc, shape (N, 2).
        rows: The scans of each cell's quarters, see `_quarters`.
    """

    first: int
    rows_columns: Ints32
    running: Ints32
    links: Bytes
    steps: Ints
    offsets: Ints
    rows: Ints32


class Comparison(NamedTuple):
    """Arguments of `kernel.compare` beside two scans and evidence; see `neighbourhood_sums`."""

    limit: Floats32
    inverse_cap: Floats32
    use: Floats32
    tau: float
    c0: float
    c2: float


class Posterior(NamedTuple):
    """Settings of the mean over the noise that moves the posterior.

    Attributes:
        prior: What is known of the pose before the scan, 1 / square metres.
        shifts: Points of the rule for the mean, deviations, shape (7, 2).
        weights: Their weights.
    """

    prior: float
    shifts: Floats
    weights: Floats


def coastal_entropy(context: LayerContext, *, people: float = PEOPLE) -> dict[str, Floats32]:
    """Compute the expected entropy of the pose after a scan, within the map's radius.

    Args:
        context: What the map was made of.
        people: How many people a beam meets in a metre in the mean, 1 / metres; 0: none.

    Returns:
        coastal_entropy and coastal_entropy_gain, bits.

    Raises:
        InputError: `people` is negative or no number.
    """
    people = as_nonnegative(people, "people", "per metre")
    lattice, table, model = context.lattice, context.table, context.model
    steps = math.floor(model.radius / lattice.spacing + 1e-9)
    share, inverse_cap = _known_pose(context)
    evidences = _evidence(table, share)
    # The prior is the neighbourhood.
    posterior = Posterior(4.0 / model.radius**2, SHIFTS, WEIGHTS)
    comparison = Comparison(
        table.limit, inverse_cap, table.use, model.tau,
        (lattice.spacing / 2) ** 2 / SQUARE, model.sigma_theta**2,
    )  # fmt: skip
    offsets = disc(model.radius, lattice.spacing)
    results = np.empty((len(context.headings), len(context.points[0]), 2), dtype=np.float32)
    for h in range(len(context.headings)):
        links = context.links(h)
        for band in bands(context, steps, 2 * (1 + len(QUARTERS))):
            data, rows = _quarters(context, h, band.part)
            around = Neighbourhood(
                band.first, lattice.rows_columns, lattice.index, links[band.first : band.last],
                STEPS, offsets, rows,
            )  # fmt: skip
            run_rows(
                _entropies, band.end - band.begin, band.begin, around,
                _reweighted(data, table, share, people), comparison, evidences, posterior,
                results[h, band.begin : band.end], least=8,
            )  # fmt: skip
    entropy, gain = (context.spread(values) for values in np.ascontiguousarray(results.T))
    return {"coastal_entropy": entropy, "coastal_entropy_gain": gain}


def _quarters(context: LayerContext, heading: int, part: slice) -> tuple[Floats32, Ints32]:
    """Return scans of N poses at their cells' centres, then at the centres of their quarters.

    Returns:
        Beam returns, shape (5 N, 5, P), and the rows of each cell's quarters, shape (N, 4): -1
        where the robot cannot stand there, and the centre's where it can stand in none.
    """
    x, y = (axis[part] for axis in context.points)
    count, angle, robot = len(x), float(context.headings[heading]), context.model.robot_radius
    data = np.zeros((5 * count, 5, len(context.table.limit)), dtype=np.float32)
    data[:, 4] = 1.0
    rows = np.full((count, len(QUARTERS)), -1, dtype=np.int32)
    steps = np.vstack([np.zeros((1, 2)), context.spacing * QUARTERS])
    for k, (dx, dy) in enumerate(steps.tolist()):
        beam_returns(
            context.environment, context.scanner, context.table, x + dx, y + dy, angle,
            data[k * count : (k + 1) * count],
        )  # fmt: skip
        if k > 0:
            stands = can_stand(
                context.environment, context.full_scanner, x + dx, y + dy, angle, robot
            )
            rows[stands, k - 1] = k * count + np.flatnonzero(stands)
    nowhere = (rows < 0).all(axis=1)
    rows[nowhere, 0] = np.flatnonzero(nowhere)
    return data, rows


def expected_evidence(odd: float, floor: float) -> tuple[float, float]:
    """Compute the mean evidence of a beam at a known pose, over its noise and over being odd.

    Args:
        odd: Share of beams that are odd, e, above 0 and below 1.
        floor: Their density relative to the peak of the others, f, above 0.

    Returns:
        (1 - e) E[rho''(n)], what small differences count, and (1 - e) (-log f - E[rho(n)]), the
        most that a beam can tell; see the module.
    """
    normal = np.exp(-0.5 * NOISE**2)
    weight = normal / normal.sum()
    mixed = (1.0 - odd) * normal + floor
    fits = (1.0 - odd) * normal / mixed
    # rho' = z fits and fits' = - z fits (1 - fits).
    bend = fits * (1.0 - NOISE**2 * (1.0 - fits))
    full_evidence = weight @ (np.log(mixed) - math.log(floor))
    return (1.0 - odd) * float(weight @ bend), (1.0 - odd) * float(full_evidence)


def _known_pose(context: LayerContext) -> tuple[Floats32, Floats32]:
    """Return per beam the weight of small differences and 1 / its maximum evidence, shape (P,)."""
    table, scanner, beams = context.table, context.scanner, context.table.beams
    shares = [s.random_share + s.lost_share for s in scanner.sensors]
    odd = np.minimum(context.model.outlier_share + np.array(shares), 0.99)[scanner.sensor_of_beam]
    peak = 1.0 / np.sqrt(2.0 * math.pi * 2.0 * table.spread[:beams].min(axis=1))
    floor = odd * np.minimum(1.0 / (peak * (table.limit[:beams] - table.nearest)), 1.0)
    # The density of intensities is unknown: an odd one is as likely as any other.
    pairs = np.vstack([np.column_stack([odd, floor]), np.column_stack([odd[table.intensity]] * 2)])
    kinds, which = np.unique(pairs, axis=0, return_inverse=True)
    share_and_cap = np.ones((len(table.limit), 2))  # padding has any
    share_and_cap[: len(pairs)] = np.array([expected_evidence(*kind) for kind in kinds.tolist()])[
        which.reshape(-1)
    ]
    share, cap = share_and_cap.T.astype(np.float32)
    return share, 1.0 / cap


def _evidence(table: BeamTable, share: Floats32) -> Floats32 | None:
    """Return the evidence table for the variance of `_reweighted`, or None if all bins are fine.

    One row a beam. A difference of z deviations is there one of z sqrt(2 share).
    """
    if table.width.max() <= FINE:
        return None
    width = np.pad(table.width, (0, len(share) - table.columns), constant_values=table.width[0])
    kinds, beam = np.unique(np.stack([width, share], axis=1), axis=0, return_inverse=True)
    # As in `evidence_table`.
    z = np.maximum(np.arange(round(Z_MAX / Z_STEP) + 2) * Z_STEP, 0.01)
    rows = []
    for wide, evidence_share in kinds.tolist():
        scaled = z / math.sqrt(2.0 * evidence_share)
        rows.append(evidence(scaled, wide) / (scaled * scaled / 4.0))
    return np.array(rows, dtype=np.float32)[beam.reshape(-1)]


def _reweighted(data: Floats32, table: BeamTable, share: Floats32, people: float) -> Floats32:
    """Return beam returns with twice the evidence, as at a known pose, reduced for people."""
    # The evidence goes with 1 / variance.
    people_met = np.float32(people) * np.minimum(data[:, 0], table.limit)
    # A person in front of a beam hides its intensity too.
    people_met[:, table.beams : table.columns] = people_met[:, table.intensity]
    data[:, 4] *= np.exp(np.minimum(people_met, CROWD)) / (np.float32(2.0) * share)
    return data


@kernel(fastmath=FAST)
def likelihoods(row, column, marks, around, data, comparison, evidence, scan, cell, matches):
    """Compare the pose with itself, then with the quarters of each marked cell.

    Written a row each: which scan, int32, `scan`; which cell, -1 for the pose itself, int32,
    `cell`; and log of I (less that of the quarters in the cell), the best offset x and y and its
    covariance xx, xy, yy, `matches`.

    Returns:
        How many rows there are.
    """
    first, _, index, _, _, offsets, rows = around
    limit, icap, use, tau, c0, c2 = comparison
    k = np.abs(offsets).max()
    side = 2 * k + 1
    p = index[row, column] - first
    scan[0], cell[0], matches[0, 0] = p, -1, 0.0
    count = 1
    for o in range(offsets.shape[0]):
        if marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] != 2:
            continue
        q = index[row + offsets[o, 0], column + offsets[o, 1]] - first
        low = count
        for part in range(rows.shape[1]):
            if rows[q, part] >= 0:
                scan[count], cell[count] = rows[q, part], o
                count += 1
        for n in range(low, count):
            matches[n, 0] = -math.log(count - low)
    for n in range(count):
        alike, ox, oy, _, sxx, sxy, syy, _ = compare(
            data, p, scan[n], limit, icap, use, evidence, tau, c0, c2
        )
        matches[n, 0] += math.log(max(alike, 1e-300))
        matches[n, 1], matches[n, 2] = ox, oy
        matches[n, 3], matches[n, 4], matches[n, 5] = sxx, sxy, syy
    return count


@kernel
def noise_root(xx, xy, yy, c0, prior):
    """Return the symmetric root (xx, xy, yy) of the covariance of the posterior's motion.

    (xx, xy, yy) is the covariance of the offset at the pose after the scan, if it is c0 before.
    With A what the scan tells and `prior` what is known before it, the posterior of the whole
    neighbourhood is (A + prior)^-1, and noise moves it by (A + prior)^-1 A (A + prior)^-1.
    """
    half, mean = 0.5 * math.hypot(xx - yy, 2.0 * xy), 0.5 * (xx + yy)
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
    wide = max(1.0 / (mean + half) - 1.0 / c0, 0.0)
    narrow = max(1.0 / (mean - half) - 1.0 / c0, 0.0)
    wide, narrow = math.sqrt(wide) / (wide + prior), math.sqrt(narrow) / (narrow + prior)
    c, s = math.cos(angle), math.sin(angle)
    return (
        wide * c * c + narrow * s * s, (wide - narrow) * c * s, wide * s * s + narrow * c * c,
    )  # fmt: skip


@kernel
def entropy_of(cell, matches, count, c0, posterior, scratch):
    """Return the expected entropy, nats, of the cells in `likelihoods`, and their count."""
    prior, shifts, weights = posterior
    xx, xy, yy = noise_root(matches[0, 3], matches[0, 4], matches[0, 5], c0, prior)
    expected, cells = 0.0, 0
    for k in range(weights.size):
        # In units of the quarters' variance.
        ux = (xx * shifts[k, 0] + xy * shifts[k, 1]) / c0
        uy = (xy * shifts[k, 0] + yy * shifts[k, 1]) / c0
        most = -math.inf
        for n in range(1, count):
            # The Gaussian of a quarter that is moved by -u over that of one that is not, in the
            # mean of the posterior within the quarter; what all have in common is left out.
            moved = 0.5 * (matches[n, 3] * ux * ux + 2.0 * matches[n, 4] * ux * uy)
            moved += 0.5 * matches[n, 5] * uy * uy - matches[n, 1] * ux - matches[n, 2] * uy
            scratch[n] = matches[n, 0] + moved
            most = max(most, scratch[n])
        total, weighted, share, cells = 0.0, 0.0, 0.0, 0
        for n in range(1, count):
            share += math.exp(scratch[n] - most)
            if n + 1 == count or cell[n + 1] != cell[n]:
                total += share
                if share > 0.0:
                    weighted += share * math.log(share)
                share = 0.0
                cells += 1
        expected += weights[k] * (math.log(total) - weighted / total)
    return expected, cells


@kernel
def _entropies(low, high, begin, around, data, comparison, evidence, posterior, out):
    first, rows_columns, index, links, steps, offsets, rows = around
    side = 2 * np.abs(offsets).max() + 1
    marks = np.empty(side * side, dtype=np.uint8)
    queue = np.empty(side * side, dtype=np.int32)
    size = 1 + offsets.shape[0] * rows.shape[1]
    scan, cell = np.empty(size, dtype=np.int32), np.empty(size, dtype=np.int32)
    matches, scratch = np.empty((size, 6)), np.empty(size)
    for i in range(low, high):
        row, column = rows_columns[begin + i, 0], rows_columns[begin + i, 1]
        reach(row, column, index, first, links, offsets, side, steps, marks, queue)
        count = likelihoods(
            row, column, marks, around, data, comparison, evidence, scan, cell, matches
        )
        nats, cells = entropy_of(cell, matches, count, comparison.c0, posterior, scratch)
        most = math.log2(cells)
        bits = min(max(nats / math.log(2.0), 0.0), most)
        out[i, 0], out[i, 1] = bits, most - bits


def _reach(context: LayerContext, **_: object) -> float:
    """Return the distance at which a change affects the layer: scans within the radius count."""
    return context.sight + context.radius + context.spacing


LAYER = Layer(
    name="coastal_entropy",
    title="expected entropy of the pose after a scan",
    unit="bits",
    source="after Roy, Burgard, Fox and Thrun 1999, Coastal navigation (ICRA)",
    worse="high",
    compute=coastal_entropy,
    compares_cells=True,
    in_space=True,
    reach=_reach,
    companions={"coastal_entropy_gain": ("what a scan is expected to tell of the pose", "bits")},
    high_is_good=("coastal_entropy_gain",),
)
