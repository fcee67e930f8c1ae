"""Perceptual aliasing of reflectors: wrong poses from which those in view look the same.

Reflectors have no names: a robot that does not know where it is has to recognise them by the
distances between them (Ronzoni, Olmi, Secchi and Fantuzzi 2011, "AGV global localization using
indistinguishable artificial landmarks", ICRA). It takes a wrong pose for its own if a rigid motion
of the plane maps the reflectors in view onto others, or onto one another: the image of its pose is
then the wrong pose. So all motions are enumerated that map pairs of reflectors onto pairs of the
same distance; each is fitted to all reflectors that it maps onto others, and kept if they are as
many as the robot needs.

The *margin* of a pose is the number of reflectors in view that the best wrong pose does not
explain. At 0 the reflectors do not distinguish the two poses. A reflector that should be seen from
the wrong pose, but is not, does not count as a contradiction: something may hide it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ambinav.geometry.lattice import Lattice
from ambinav.layers.reflectors.targets import Targets
from ambinav.runtime.array_types import Bools, Floats, Ints32
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows

APART: Final = 0.5
"""A pose is wrong that is farther away than this, metres,"""
TURNED: Final = math.radians(30.0)
"""or turned by more than this."""
ONES: Final = np.array([byte.bit_count() for byte in range(256)], dtype=np.uint8)
"""Number of ones in a byte."""


@dataclass(frozen=True, eq=False)
class Motions:
    """M rigid motions that map reflectors onto reflectors.

    Attributes:
        of: Cosine and sine of the angle, and x and y of the shift (metres), shape (M, 4).
        onto: Reflector onto which each is mapped, int32, shape (M, L); -1 for none.
    """

    of: Floats
    onto: Ints32

    def __len__(self) -> int:
        """Return the number of motions."""
        return len(self.of)


def find_motions(targets: Targets, together: Bools, tolerance: float, needed: int) -> Motions:
    """Find the motions that map at least `needed` reflectors onto reflectors.

    Args:
        targets: L reflectors.
        together: Which pairs can be seen from one pose, shape (L, L).
        tolerance: Distance within which an image is taken for a reflector, metres.
        needed: How many, at least 2.
    """
    count = len(targets)
    by_map: dict[bytes, Floats] = {}
    first, second = np.nonzero(together & ~np.eye(count, dtype=np.bool_))
    distance = np.hypot(*(targets.middle[first] - targets.middle[second]).T)
    onto = np.empty((len(first), count), dtype=np.int32)
    of = np.empty((len(first), 4))
    for i, j in np.argwhere(np.triu(together, 1)).tolist():
        length = math.dist(targets.middle[i], targets.middle[j])
        alike = np.flatnonzero(np.abs(distance - length) <= 2.0 * tolerance)
        motion_count = _map_pair(
            i, j, first[alike], second[alike], targets.middle, tolerance, needed, of, onto
        )
        by_map |= {onto[k].tobytes(): of[k].copy() for k in range(motion_count)}
    if not by_map:
        return Motions(np.empty((0, 4)), np.empty((0, count), dtype=np.int32))
    maps = np.stack([np.frombuffer(key, dtype=np.int32) for key in by_map])
    return Motions(np.stack(list(by_map.values())), maps)


def margins(
    lattice: Lattice, possible: Bools, headings: Floats, seen: Bools, motions: Motions
) -> Ints32:
    """Count the reflectors in view that the best wrong pose does not explain.

    Args:
        lattice: P free points.
        possible: Where the robot can stand, shape (P, H).
        headings: Headings, radians, shape (H,); one if the scanner sees the same at all.
        seen: Reflectors in view, shape (P, H, L).
        motions: See `find_motions`.

    Returns:
        int32, shape (P, H).
    """
    result = np.empty(seen.shape[:2], dtype=np.int32)
    x, y = lattice.points
    seen_from = np.ascontiguousarray(seen & possible[:, :, None])
    bits = np.packbits(motions.onto >= 0, axis=1)
    views = np.packbits(seen, axis=2)
    run_rows(
        _margins, len(x), x, y, lattice.x[0], lattice.y[0], lattice.spacing, lattice.index,
        np.asarray(headings, dtype=np.float64), np.ascontiguousarray(seen), seen_from, views,
        motions.of, motions.onto, bits, ONES, result, least=64,
    )  # fmt: skip
    return result


@kernel
def _map_pair(i, j, first, second, middle, tolerance, needed, of, onto):
    """Write the motions that map reflectors i and j onto pairs; return how many there are."""
    kept = 0
    ix, iy, jx, jy = middle[i, 0], middle[i, 1], middle[j, 0], middle[j, 1]
    for pair in range(first.size):
        k, m = first[pair], second[pair]
        kx, ky, mx, my = middle[k, 0], middle[k, 1], middle[m, 0], middle[m, 1]
        ux, uy, vx, vy = jx - ix, jy - iy, mx - kx, my - ky
        length = math.sqrt((ux * ux + uy * uy) * (vx * vx + vy * vy))
        c, s = (ux * vx + uy * vy) / length, (ux * vy - uy * vx) / length
        hx, hy = 0.5 * (ix + jx), 0.5 * (iy + jy)
        tx = 0.5 * (kx + mx) - (c * hx - s * hy)
        ty = 0.5 * (ky + my) - (s * hx + c * hy)
        row = onto[kept]
        # A pair fixes a motion roughly; all that it maps fix it well.
        if _match(c, s, tx, ty, middle, 2.0 * tolerance, row) < needed:
            continue
        c, s, tx, ty = _fitted(middle, row)
        if _match(c, s, tx, ty, middle, tolerance, row) < needed:
            continue
        same = True
        for n in range(row.size):
            same &= row[n] < 0 or row[n] == n
        if not same:
            of[kept, 0], of[kept, 1], of[kept, 2], of[kept, 3] = c, s, tx, ty
            kept += 1
    return kept


@kernel
def _match(c, s, tx, ty, middle, tolerance, row):
    """Write the reflector nearest to each one's image, -1 for none near; return how many."""
    count = 0
    for n in range(row.size):
        x = c * middle[n, 0] - s * middle[n, 1] + tx
        y = s * middle[n, 0] + c * middle[n, 1] + ty
        best, row[n] = tolerance * tolerance, -1
        for m in range(row.size):
            dx, dy = middle[m, 0] - x, middle[m, 1] - y
            away = dx * dx + dy * dy
            if away <= best:
                best, row[n] = away, m
        count += row[n] >= 0
    return count


@kernel
def _fitted(middle, row):
    """Return the motion that maps reflectors onto those in `row` by least squares.

    Source: the plane case of Kabsch 1976, "A solution for the best rotation to relate two sets of
    vectors", Acta Crystallographica A32.
    """
    count = 0
    ax = ay = bx = by = 0.0
    for n in range(row.size):
        if row[n] >= 0:
            ax, ay = ax + middle[n, 0], ay + middle[n, 1]
            bx, by = bx + middle[row[n], 0], by + middle[row[n], 1]
            count += 1
    ax, ay, bx, by = ax / count, ay / count, bx / count, by / count
    dot = cross = 0.0
    for n in range(row.size):
        if row[n] >= 0:
            px, py = middle[n, 0] - ax, middle[n, 1] - ay
            qx, qy = middle[row[n], 0] - bx, middle[row[n], 1] - by
            dot += px * qx + py * qy
            cross += px * qy - py * qx
    angle = math.atan2(cross, dot)
    c, s = math.cos(angle), math.sin(angle)
    return c, s, bx - (c * ax - s * ay), by - (s * ax + c * ay)


@kernel
def _margins(
    low, high, x, y, x0, y0, spacing, index, headings, seen, seen_from, views, of, onto, bits,
    ones, result,
):  # fmt: skip
    turn = 2.0 * math.pi
    count = headings.size
    view = np.empty(seen.shape[2], dtype=np.int32)
    for p in range(low, high):
        for h in range(count):
            size = 0
            for k in range(seen.shape[2]):
                if seen[p, h, k]:
                    view[size] = k
                    size += 1
            most = 0
            for t in range(of.shape[0]):
                mapped = 0
                for byte in range(bits.shape[1]):
                    mapped += ones[bits[t, byte] & views[p, h, byte]]
                if mapped <= most:
                    continue
                c, s = of[t, 0], of[t, 1]
                qx = c * x[p] - s * y[p] + of[t, 2]
                qy = s * x[p] + c * y[p] + of[t, 3]
                angle = math.atan2(s, c)
                if math.hypot(qx - x[p], qy - y[p]) <= APART and abs(angle) <= TURNED:
                    continue
                row, column = round((qy - y0) / spacing), round((qx - x0) / spacing)
                if not (0 <= row < index.shape[0] and 0 <= column < index.shape[1]):
                    continue
                wrong = index[int(row), int(column)]
                if wrong < 0:
                    continue
                best, to = math.inf, 0
                for g in range(count):
                    off = abs((headings[g] - headings[h] - angle + 0.5 * turn) % turn - 0.5 * turn)
                    if off < best:
                        best, to = off, g
                explained = 0
                for k in view[:size]:
                    explained += onto[t, k] >= 0 and seen_from[wrong, to, onto[t, k]]
                most = max(most, explained)
            result[p, h] = size - most
