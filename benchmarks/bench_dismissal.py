"""Potential gain from early rejection of neighbours: required bounds on I, and known bounds.

Of random poses every neighbour is compared in full. `share of pairs`: those whose I is at least a
part of the pose's own I(p, p); `level without the rest`: by how much level then differs, if which
ones these are were known for nothing. Bounds: at which share of pairs a proof from below of
-log(I / I(p, p)) falls short of the log of that part, so that they would have to be compared.

Both bounds rest on this. Whatever offset e0 the first step finds, the quadratic of each beam
touches its capped evidence c(U_i(e)) from above, for c is concave in the squared residual, and is
nowhere negative. So for any subset of beams

    -log I >= min over e of [ sum_i c(U_i(e)) / tau + e^T C^-1 e / 2 ].

- split: each beam has the n-th part of the cost of the offset to itself. Then each beam's minimum
  stands alone, the variance of its residual grown by (n / tau) g^T C g.
- chord: offsets dearer than T need not be looked at. Of those that are left each moves beam i by at
  most m_i = sqrt(2 T g^T C g), and up to there c(U) is at least its chord, a quadratic in e: the
  minimum of their sum is that of one step of the kernel. The better of six T.

Beams that could fall silent within the cell are left in, which flatters the bounds.
"""

from __future__ import annotations

import argparse
import math

import numpy as np
from harness import add_out, environment_path, report, table
from map_case import RADIUS, SPACING, plain_scanner
from numpy.typing import NDArray

from ambinav.ambiguity.gaussian import FAST
from ambinav.ambiguity.model import independent_tau
from ambinav.ambiguity.pair import compare
from ambinav.ambiguity.reach import reach
from ambinav.ambiguity.returns import BeamTable, beam_returns
from ambinav.ambiguity.tensor import relative_radii
from ambinav.buildings.load import load_environment
from ambinav.geometry.lattice import STEPS, Lattice
from ambinav.runtime.kernels import kernel
from ambinav.sensing.scanner import RangeScanner

PARTS = (1e-3, 1e-4, 1e-5, 1e-6)
DEAREST = (4.0, 8.0, 12.0, 15.0, 20.0, 30.0)
CELL = (SPACING**2 / 4, 0.05**2)
Floats = NDArray[np.float64]


@kernel(fastmath=FAST)
def _compare_all(chosen, rows_columns, index, links, offsets, steps, data, limit, icap, use, tau, c0, c2, out):  # type: ignore[no-untyped-def]  # fmt: skip  # noqa: E501
    k = np.abs(offsets).max()
    side = 2 * k + 1
    marks, queue = np.empty(side * side, dtype=np.uint8), np.empty(side * side, dtype=np.int32)
    for i in range(chosen.size):
        row, column = rows_columns[chosen[i], 0], rows_columns[chosen[i], 1]
        reach(row, column, index, 0, links, offsets, side, steps, marks, queue)
        for o in range(offsets.shape[0]):
            if marks[(offsets[o, 0] + k) * side + offsets[o, 1] + k] == 2:
                q = index[row + offsets[o, 0], column + offsets[o, 1]]
                alike, ox, oy, _, sxx, sxy, syy, _ = compare(
                    data, chosen[i], q, limit, icap, use, None, tau, c0, c2
                )
                out[i, o, 0], out[i, o, 1], out[i, o, 2] = alike, ox, oy
                out[i, o, 3], out[i, o, 4], out[i, o, 5], out[i, o, 6] = sxx, sxy, syy, q


def level(pairs: Floats, steps: Floats, kept: NDArray[np.bool_]) -> Floats:
    """Return the level of each pose from the remaining pairs; `pairs` as by `_compare_all`."""
    near = np.isfinite(pairs[..., 0])
    weight = np.where(kept & near, pairs[..., 0], 0.0)
    x, y = steps[:, 0] + pairs[..., 1], steps[:, 1] + pairs[..., 2]
    c = CELL[0]

    def mean(values: Floats, weights: Floats) -> Floats:
        return np.asarray(np.nansum(values * weights, axis=1) / weights.sum(axis=1))

    alike = (x * x + pairs[..., 3], x * y + pairs[..., 4], y * y + pairs[..., 5])
    free = (steps[:, 0] ** 2 + c, steps[:, 0] * steps[:, 1], steps[:, 1] ** 2 + c)
    columns = [np.ones(len(pairs)), *(mean(v, weight) for v in alike)]
    columns += [mean(v, near.astype(float)) for v in free]
    return relative_radii(np.column_stack(columns))["level"]


def proofs(p: Floats, q: Floats, limit: Floats, cap: Floats, tau: float) -> tuple[Floats, Floats]:
    """Return the bounds `split` and `chord` of -log I(p, q); p of shape (5, B), q of (Q, 5, B)."""
    c0, c2 = CELL
    z = np.minimum(p[0], limit) - np.minimum(q[:, 0], limit)
    spread = p[4] + q[:, 4]
    gradient = np.moveaxis(q[:, 1:4], 1, 2)
    moved = (gradient**2 * (c0, c0, c2)).sum(axis=-1)

    def capped(u: Floats) -> Floats:
        return np.asarray(u / np.sqrt(1.0 + (u / cap) ** 2))

    split = capped(z * z / 4 / (spread + len(limit) / tau * moved / 2)).sum(axis=1) / tau
    chord = np.zeros(len(q))
    for dearest in DEAREST:
        u = (np.abs(z) + np.sqrt(2 * dearest * moved)) ** 2 / 4 / spread
        w = 1.0 / np.sqrt(1.0 + (u / cap) ** 2) / spread
        H = np.einsum("qbi,qb,qbj->qij", gradient, w, gradient) / (2 * tau)
        g = np.einsum("qbi,qb->qi", gradient, w * z) / (2 * tau)
        best = np.linalg.solve(H + np.diag([1 / c0, 1 / c0, 1 / c2]), g[..., None])[..., 0]
        least = (w * z * z).sum(axis=1) / 4 / tau - (g * best).sum(axis=1) / 2
        chord = np.maximum(chord, np.minimum(least, dearest))
    return np.asarray(split), chord


def study(name: str, scanner: RangeScanner, count: int, bounded: int, seed: int) -> str:
    """Return the section of one map and scanner."""
    env = load_environment(environment_path(name))
    lattice, beams = Lattice.over(env, SPACING), BeamTable.of(scanner, env.map_std, 0.05)
    x, y = lattice.points
    data = np.zeros((len(x), 5, len(beams.limit)), dtype=np.float32)
    beam_returns(env, scanner, beams, x, y, 0.0, data)
    cells = np.arange(-round(RADIUS / SPACING), round(RADIUS / SPACING) + 1)
    rows, columns = (axis.ravel() for axis in np.meshgrid(cells, cells, indexing="ij"))
    disc = (rows**2 + columns**2) * SPACING**2 <= RADIUS**2 * (1 + 1e-9)
    offsets = np.stack([rows[disc], columns[disc]], axis=1)
    tau = independent_tau(scanner)
    chosen = np.random.default_rng(seed).choice(len(x), size=count, replace=False)
    pairs = np.full((count, len(offsets), 7), np.nan)
    _compare_all(
        chosen, lattice.rows_columns, lattice.index, lattice.links, offsets, STEPS, data,
        beams.limit, beams.inverse_cap, beams.use, tau, *CELL, pairs,
    )  # fmt: skip
    itself = pairs[:, (offsets == 0).all(axis=1), 0]
    relative = pairs[..., 0] / itself
    near = np.isfinite(relative)
    steps = offsets[:, ::-1] * SPACING
    full = level(pairs, steps, near)
    limit, cap = beams.limit[: beams.beams].astype(float), 1.0 / beams.inverse_cap[: beams.beams]
    proved_parts: list[Floats] = []
    for i in range(bounded):
        q = pairs[i, near[i], 6].astype(int)
        scans = data[:, :, : beams.beams]
        bounds = proofs(
            scans[chosen[i]].astype(float), scans[q].astype(float), limit, cap.astype(float), tau
        )
        proved_parts.append(np.stack([np.exp(-bound) / itself[i] for bound in bounds]))
    proved = np.concatenate(proved_parts, axis=1)
    exact = relative[:bounded][near[:bounded]]
    table_rows = []
    for part in PARTS:
        off = np.abs(level(pairs, steps, relative >= part) - full)
        table_rows.append(
            (
                f"{part:g}", f"{(relative[near] >= part).mean():.3f}", f"{off.max():.1e}",
                f"{np.quantile(off, 0.99):.1e}", f"{(proved[0] >= part).mean():.3f}",
                f"{(proved[1] >= part).mean():.3f}",
            )
        )  # fmt: skip
    return "\n\n".join(
        [
            f"## {name}, {scanner.name or 'plain'}, {beams.beams} beams",
            f"{count} poses, {int(near.sum())} pairs; bounds at {bounded} of them. I(p, p): "
            f"{np.median(itself):.3g} in the median. Of all pairs "
            + ", ".join(f"{(pairs[..., 0][near] < t).mean():.1%} are below {t:g}" for t in
                        (1e-2, 1e-3, 1e-4))
            + f". Pairs that a bound says are smaller than they are: "
            f"{int((proved < exact * (1 - 1e-4)).sum())}.",
            table(
                (
                    "from this part of I(p, p) on", "share of pairs",
                    "level without the rest: greatest", "99 %", "left by split", "left by chord",
                ),
                table_rows,
            ),
        ]
    )  # fmt: skip


def main() -> None:
    """Measure as the command line says, and report."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--poses", type=int, default=4000, help="default: %(default)s")
    parser.add_argument("--bounded", type=int, default=500, help="default: %(default)s")
    parser.add_argument("--seed", type=int, default=1)
    add_out(parser)
    args = parser.parse_args()
    fan = RangeScanner.from_preset("hokuyo-urg-04lx")
    scanners = (plain_scanner(), fan.thinned(round(60 * fan.aperture / math.tau)))
    sections = [study("willow_full_005", s, args.poses, args.bounded, args.seed) for s in scanners]
    body = "\n\n".join([str(__doc__).split("\n\n", 1)[1].strip(), *sections])
    report("Dismissing neighbours early", ("ambinav", "numba", "numpy"), body, args.out)


if __name__ == "__main__":
    main()
