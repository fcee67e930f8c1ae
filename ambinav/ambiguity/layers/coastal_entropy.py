"""What is left to be told of the pose when a scan has been taken: coastal navigation.

Source: after N. Roy, W. Burgard, D. Fox and S. Thrun, "Coastal navigation: mobile robot navigation
with uncertainty in dynamic environments", ICRA 1999: the robot keeps to where a scan is expected to
leave the least entropy of its pose, E_s[H(pose | scan s)], in a building where people block
beams. The paper itself was not at hand; all that follows is our own reading.

Before the scan the robot is as probably in one cell of the neighbourhood as in another: the free
cells within the map's radius R that free steps between possible poses lead to. Readings r_i make
the cell q as probable as

    b(q) ~ integral over q's cell of exp(-sum_i rho(z_i) / tau),   z_i = (r_i - d_i(q)) / s_i,
    rho(z) = -log((1 - e) exp(-z^2 / 2) + e).

e is the share of beams that meet what is not on the map (the model's `outlier_share`, with the
sensor's random and lost readings). exp(-z^2 / 2) is the likelihood of a noisy reading at a known
pose, relative to its peak; an odd beam tells no pose from another, so its relative likelihood is 1.
Hence rho ends at -log e: the cap of the model's own indistinguishability I(p, q), where the same
share is mixed with exp(-z^2 / 4), for there both scans are noisy. Twice the evidence of I, then,
under the same cap; halving tau would double both, and stand for a share of e^2.

The readings are those at p, with their noise n and their odd beams. What a beam tells of q against
p is, in the mean of both,

    E[rho(n + z) - rho(n)] = (1 - e) (k z^2 / 2 for small z, -log e - E[rho(n)] for large ones),

k = E[rho''(n)] (`expected_evidence`): noise alone uses up some of what a capped beam can tell, at
e = 0.05 a quarter of it. The integral over a cell then is that of I (docs/model.md), with evidence
and cap of this size. The weight within a cell is that of a point anywhere in it, h^2 / 12, not the
h^2 / 4 of the tensor, whose overlapping cells would leave nearly 2 bits where the pose is known
exactly. Noise also moves the whole posterior, by a Gaussian as wide as itself: the entropy of its
cells is the mean over that, by a rule of seven points that is exact to the fifth order. To move
the posterior against the cells is in closed form, so no beam is compared twice. Then

    H(p) = E[- sum_q b(q) log2 b(q)]   bits, from 0 to log2 of the number of cells,

which rises by 2 bits where the spacing is halved and nothing else changes. `coastal_entropy_gain`
is that number of bits less H: what the scan tells.

People stand anywhere with the same probability, so a beam meets one within each metre with the
same chance and comes through d metres with exp(-people d). A beam that is blocked tells nothing of
the pose; its evidence counts with the probability that it is not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.indistinguishability import FINE, Z_MAX, Z_STEP, evidence
from ambinav.ambiguity.kernel import FAST, compare, reach
from ambinav.ambiguity.layers.bands import bands
from ambinav.ambiguity.layers.ground import Ground
from ambinav.ambiguity.layers.registry import Layer
from ambinav.ambiguity.returns import BeamTable
from ambinav.errors import InputError
from ambinav.geometry.lattice import STEPS
from ambinav.kernels import kernel
from ambinav.sensing.fields import as_number
from ambinav.threads import run_rows

# People met by a beam in a metre: one in 20 m, a corridor with somebody in it.
PEOPLE = 0.05
# Nobody sees past so many people in the mean: e^-20 of the evidence is nothing.
CROWD = np.float32(20.0)
# Squared spacing over the variance of a point that is anywhere in its cell.
CELL = 12.0
# Noise that a normal distribution is integrated over, in deviations, for `expected_evidence`.
NOISE = np.linspace(-10.0, 10.0, 4001)
# The rule for means over a normal distribution of the plane: its middle, and six points around.
SHIFTS = np.array(
    [(0.0, 0.0), *((2 * math.cos(k), 2 * math.sin(k)) for k in math.pi / 3 * np.arange(6))]
)
WEIGHTS = np.array([1 / 2, *[1 / 12] * 6])


def coastal_entropy(ground: Ground, *, people: float = PEOPLE) -> dict[str, NDArray[np.float32]]:
    """Expected entropy of the pose after a scan, among the cells within the map's radius.

    Args:
        ground: What the map was made of.
        people: How many people a beam meets in a metre in the mean, 1 / metres; 0: none.

    Returns:
        coastal_entropy and coastal_entropy_gain, bits.

    Raises:
        InputError: `people` is negative or no number.
    """
    people = as_number(people, "people")
    if people < 0.0:
        raise InputError(f"people is {people}; give at least 0 per metre.")
    lattice, table, model = ground.lattice, ground.table, ground.model
    steps = math.floor(model.radius / lattice.spacing + 1e-9)
    share, inverse_cap = _known_pose(table)
    told = _evidence(table, share)
    # What is known before the scan is the neighbourhood.
    prior = 4.0 / model.radius**2
    offsets = _disc(steps, model.radius / lattice.spacing)
    found = np.empty((2, len(ground.points[0]), len(ground.headings)), dtype=np.float32)
    for h in range(len(ground.headings)):
        links = ground.links(h)
        for band in bands(ground, steps):
            data = _known(ground.returns(h, band.part).data, table, share, people)
            run_rows(
                _entropies, band.end - band.begin, band.begin, band.first, lattice.rows_columns,
                lattice.index, links[band.first : band.last], STEPS, offsets, data,
                table.limit, inverse_cap, table.use, told, model.tau,
                lattice.spacing**2 / CELL, model.sigma_theta**2, prior, SHIFTS, WEIGHTS,
                found[:, band.begin : band.end, h], least=8,
            )  # fmt: skip
    entropy, gain = (ground.spread(values) for values in found)
    return {"coastal_entropy": entropy, "coastal_entropy_gain": gain}


def _disc(steps: int, radius: float) -> NDArray[np.int64]:
    """Row and column steps within a radius in steps, shape (N, 2)."""
    axis = np.arange(-steps, steps + 1)
    rows, columns = (one.ravel() for one in np.meshgrid(axis, axis, indexing="ij"))
    near = rows**2 + columns**2 <= radius**2 * (1 + 1e-9)
    return np.stack([rows[near], columns[near]], axis=1)


def expected_evidence(odd: float) -> tuple[float, float]:
    """What a beam tells at a known pose, in the mean over its noise and over its being odd.

    Args:
        odd: Share of beams that are odd, e, above 0 and below 1.

    Returns:
        (1 - e) E[rho''(n)], what small differences count, and (1 - e) (-log e - E[rho(n)]), the
        most that a beam can tell; see the module.
    """
    normal = np.exp(-0.5 * NOISE**2)
    weight = normal / normal.sum()
    mixed = (1.0 - odd) * normal + odd
    fits = (1.0 - odd) * normal / mixed
    # rho' = z fits and fits' = - z fits (1 - fits).
    bend = fits * (1.0 - NOISE**2 * (1.0 - fits))
    most = weight @ (np.log(mixed) - math.log(odd))
    return (1.0 - odd) * float(weight @ bend), (1.0 - odd) * float(most)


def _known_pose(table: BeamTable) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Of each beam what small differences count and 1 / the most it tells, shape (P,)."""
    caps, which = np.unique(table.inverse_cap, return_inverse=True)
    told = np.ones((len(caps), 2))
    for k, inverse in enumerate(caps.tolist()):
        if inverse > 0.0:  # it is 0 for padding
            told[k] = expected_evidence(math.exp(-1.0 / inverse))
    share, cap = told[which].T.astype(np.float32)
    return share, 1.0 / cap


def _evidence(table: BeamTable, share: NDArray[np.float32]) -> NDArray[np.float32] | None:
    """Table of evidence for the variance that `_known` gives, or None where all bins are fine.

    One row a beam. A difference of z deviations is there one of z sqrt(2 share).
    """
    if table.width.max() <= FINE:
        return None
    width = np.pad(table.width, (0, len(share) - table.beams), constant_values=table.width[0])
    kinds, beam = np.unique(np.stack([width, share], axis=1), axis=0, return_inverse=True)
    # As in `evidence_table`.
    z = np.maximum(np.arange(round(Z_MAX / Z_STEP) + 2) * Z_STEP, 0.01)
    rows = []
    for wide, told in kinds.tolist():
        apart = z / math.sqrt(2.0 * told)
        rows.append(evidence(apart, wide) / (apart * apart / 4.0))
    return np.array(rows, dtype=np.float32)[beam.reshape(-1)]


def _known(
    data: NDArray[np.float32], table: BeamTable, share: NDArray[np.float32], people: float
) -> NDArray[np.float32]:
    """Beam returns with twice the evidence, as at a known pose, as far as nobody is in the way."""
    known = data.copy()
    # The evidence goes with 1 / variance.
    met = np.float32(people) * np.minimum(data[:, 0], table.limit)
    known[:, 4] *= np.exp(np.minimum(met, CROWD)) / (np.float32(2.0) * share)
    return known


@kernel(fastmath=FAST)
def likelihoods(
    row, column, index, first, marks, offsets, data, limit, icap, use, evidence, tau, c0, c2, found
):
    """Compare the pose with each marked cell; the marked cells' number.

    Written to `found`, a row a cell: I, the best offset x and y and its covariance xx, xy, yy, of
    the pose's own cell first.
    """
    k = np.abs(offsets).max()
    side = 2 * k + 1
    p = index[row, column] - first
    count = 1
    for o in range(offsets.shape[0]):
        if marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] != 2:
            continue
        q = index[row + offsets[o, 0], column + offsets[o, 1]] - first
        alike, ox, oy, _, sxx, sxy, syy, _ = compare(
            data, p, q, limit, icap, use, evidence, tau, c0, c2
        )
        at = 0
        if q != p:
            at = count
            count += 1
        found[at, 0] = alike
        found[at, 1], found[at, 2] = ox, oy
        found[at, 3], found[at, 4], found[at, 5] = sxx, sxy, syy
    return count


@kernel
def noise_root(xx, xy, yy, c0, prior):
    """Symmetric root (xx, xy, yy) of the covariance by which noise moves the posterior.

    (xx, xy, yy) is the covariance of the offset within the pose's own cell, which is known to
    deviate by c0 beforehand, the neighbourhood by 1 / prior. With A what the scan tells, the
    posterior of the neighbourhood is (A + prior)^-1, and noise moves it by one of covariance
    (A + prior)^-1 A (A + prior)^-1.
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
def entropy_of(found, count, c0, prior, shifts, weights, scratch):
    """Expected entropy of the cells that `likelihoods` has found, nats."""
    xx, xy, yy = noise_root(found[0, 3], found[0, 4], found[0, 5], c0, prior)
    expected = 0.0
    for k in range(weights.size):
        # In units of the cell's variance.
        ux = (xx * shifts[k, 0] + xy * shifts[k, 1]) / c0
        uy = (xy * shifts[k, 0] + yy * shifts[k, 1]) / c0
        most = -math.inf
        for q in range(count):
            # The Gaussian of a cell that is moved by -u against the posterior, over that of one
            # that is not, in the mean of the posterior within the cell.
            moved = 0.5 * (found[q, 3] * ux * ux + 2.0 * found[q, 4] * ux * uy)
            moved += 0.5 * found[q, 5] * uy * uy - found[q, 1] * ux - found[q, 2] * uy
            alike = max(found[q, 0], 1e-300)
            scratch[q] = math.log(alike) + moved
            most = max(most, scratch[q])
        total, weighted = 0.0, 0.0
        for q in range(count):
            share = math.exp(scratch[q] - most)
            total += share
            weighted += share * (scratch[q] - most)
        expected += weights[k] * (math.log(total) - weighted / total)
    return expected


@kernel
def _entropies(
    low, high, begin, first, rows_columns, index, links, steps, offsets, data, limit, icap, use,
    evidence, tau, c0, c2, prior, shifts, weights, out,
):  # fmt: skip
    side = 2 * np.abs(offsets).max() + 1
    marks = np.empty(side * side, dtype=np.uint8)
    queue = np.empty(side * side, dtype=np.int32)
    found = np.empty((offsets.shape[0], 6))
    scratch = np.empty(offsets.shape[0])
    for i in range(low, high):
        row, column = rows_columns[begin + i, 0], rows_columns[begin + i, 1]
        reach(row, column, index, first, links, offsets, side, steps, marks, queue)
        count = likelihoods(
            row, column, index, first, marks, offsets, data, limit, icap, use, evidence, tau, c0,
            c2, found,
        )  # fmt: skip
        nats = entropy_of(found, count, c0, prior, shifts, weights, scratch)
        most = math.log2(count)
        bits = min(max(nats / math.log(2.0), 0.0), most)
        out[0, i], out[1, i] = bits, most - bits


LAYER = Layer(
    name="coastal_entropy",
    title="expected entropy of the pose after a scan",
    unit="bits",
    source="after Roy, Burgard, Fox and Thrun 1999, Coastal navigation (ICRA)",
    worse="high",
    compute=coastal_entropy,
    companions={"coastal_entropy_gain": ("what a scan is expected to tell of the pose", "bits")},
)
