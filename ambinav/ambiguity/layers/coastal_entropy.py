"""What is left to be told of the pose when a scan has been taken: coastal navigation.

Source: N. Roy, W. Burgard, D. Fox and S. Thrun, "Coastal navigation: mobile robot navigation with
uncertainty in dynamic environments", ICRA 1999: the robot keeps to where a scan is expected to
leave the least entropy of its pose, E_s[H(pose | scan s)], in a building where people block
beams. The paper itself was not at hand; all that follows is our own reading.

Before the scan the robot is as probably in one cell of the neighbourhood as in another: the free
cells within the map's radius R that free steps between possible poses lead to. Readings r_i make
the cell q as probable as

    b(q) ~ integral over q's cell of exp(-1/2 sum_i z_i^2 / tau),   z_i = (r_i - d_i(q)) / s_i.

For the readings that p gives in the mean that is the map's own indistinguishability I(p, q) with
twice the evidence (tau halved), integrated as docs/model.md says; I itself has half of it, -log
rho = z^2 / 4, for there both scans are noisy. The weight within a cell is that of a point anywhere
in it, h^2 / 12, not the h^2 / 4 of the tensor, whose overlapping cells would leave nearly 2 bits
where the pose is known exactly. With d linear in the pose and Gaussian noise the posterior of every
scan has the same entropy, so that of the mean scan is the expected one; the tests compare it with
sampled scans where ranges are not linear. Then

    H(p) = - sum_q b(q) log2 b(q)   bits, from 0 to log2 of the number of cells,

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

from ambinav.ambiguity.indistinguishability import FINE, evidence_table
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
    told = _evidence(table)
    offsets = _disc(steps, model.radius / lattice.spacing)
    found = np.empty((2, len(ground.points[0]), len(ground.headings)), dtype=np.float32)
    for h in range(len(ground.headings)):
        links = ground.links(h)
        for band in bands(ground, steps):
            data = _among_people(ground.returns(h, band.part).data, table, people)
            run_rows(
                _entropies, band.end - band.begin, band.begin, band.first, lattice.rows_columns,
                lattice.index, links[band.first : band.last], STEPS, offsets, data,
                table.limit, table.inverse_cap, table.use, told, model.tau / 2.0,
                lattice.spacing**2 / CELL, model.sigma_theta**2,
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


def _evidence(table: BeamTable) -> NDArray[np.float32] | None:
    """Table of evidence, one row a beam, or None where all bins are fine."""
    if table.width.max() <= FINE:
        return None
    widths, beam = np.unique(table.width, return_inverse=True)
    return np.asarray(evidence_table(widths)[np.pad(beam, (0, len(table.limit) - len(beam)))])


def _among_people(
    data: NDArray[np.float32], table: BeamTable, people: float
) -> NDArray[np.float32]:
    """Beam returns whose evidence counts as often as nobody is in the beam's way."""
    if people == 0.0:
        return data
    thinned = data.copy()
    # The evidence goes with 1 / variance.
    met = np.float32(people) * np.minimum(data[:, 0], table.limit)
    thinned[:, 4] *= np.exp(np.minimum(met, CROWD))
    return thinned


@kernel(fastmath=FAST)
def entropy_at(
    row, column, index, first, marks, offsets, data, limit, icap, use, evidence, tau, c0, c2
):
    """Entropy of the pose's cell among the marked ones, and how many they are; nats."""
    k = np.abs(offsets).max()
    side = 2 * k + 1
    p = index[row, column] - first
    total, weighted, count = 0.0, 0.0, 0
    for o in range(offsets.shape[0]):
        if marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] != 2:
            continue
        q = index[row + offsets[o, 0], column + offsets[o, 1]] - first
        count += 1
        alike = compare(data, p, q, limit, icap, use, evidence, tau, c0, c2)[0]
        total += alike
        if alike > 0.0:
            weighted += alike * math.log(alike)
    return math.log(total) - weighted / total, count


@kernel
def _entropies(
    low, high, begin, first, rows_columns, index, links, steps, offsets, data, limit, icap, use,
    evidence, tau, c0, c2, out,
):  # fmt: skip
    side = 2 * np.abs(offsets).max() + 1
    marks = np.empty(side * side, dtype=np.uint8)
    queue = np.empty(side * side, dtype=np.int32)
    for i in range(low, high):
        row, column = rows_columns[begin + i, 0], rows_columns[begin + i, 1]
        reach(row, column, index, first, links, offsets, side, steps, marks, queue)
        nats, count = entropy_at(
            row, column, index, first, marks, offsets, data, limit, icap, use, evidence, tau, c0,
            c2,
        )  # fmt: skip
        most = math.log2(count)
        bits = min(max(nats / math.log(2.0), 0.0), most)
        out[0, i], out[1, i] = bits, most - bits


LAYER = Layer(
    name="coastal_entropy",
    title="expected entropy of the pose after a scan",
    unit="bits",
    source="Roy, Burgard, Fox and Thrun 1999, Coastal navigation (ICRA)",
    worse="high",
    compute=coastal_entropy,
    companions={"coastal_entropy_gain": ("what a scan is expected to tell of the pose", "bits")},
)
