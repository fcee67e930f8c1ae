"""Information of one scan about position and heading, over a whole map.

Position: the ambiguity tensor is the second moment of the poses near by whose scan looks the same,
seen from a robot that only knew to be somewhere in the free neighbourhood. As Gaussians that is a
prior (the free neighbourhood, with radius r0 along an axis) and a posterior (ambiguity radius r),
and information adds up (Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 3.5):

    1 / r^2 = 1 / r0^2 + A,    r0 = r / ratio    =>    A = (1 - ratio^2) / r^2

with the map's `major_radius` and `major` for r and ratio along the weak direction, `minor_radius`
and `minor` across it. Where the ratio is 1 the scan tells nothing, A = 0. That is our own model.
The tensor has the heading integrated out, so A is what the scan tells of the position of a robot
that does not know its heading.

Heading: the map keeps no moments of position and heading together, so what couples them is taken
from the Fisher information F of the scan of all beams (Censi 2007, "On achievable accuracy for
range-finder localization", ICRA). With c = F_pt / F_tt, metres, by which a turn looks like a shift,
and h, what the scan tells of the heading of a robot that knows its position, the whole is

    [ A + h c c^T    h c ]
    [   h c^T         h  ]

whose Schur complement, what is left for the position if the heading is unknown, is A again. h is
F_tt / (2 tau): tau of the map says how many beams carry one piece of evidence, and the 2 is there
because indistinguishability compares two noisy scans, so that in the limit of small offsets A, too,
is half of F / tau (docs/model.md). Where the map has `heading_radius` and `heading` (those of
scanners that look all around), h is no more than what they tell by the formula above: with the
position unknown by a spacing, and less along walls, where F takes beams for linear that reach their
cap. Which of tensor, F and both predicts best was measured: docs/planning.md.

Echoes: a localizer with a likelihood field (Thrun, Burgard & Fox 2005, section 6.4) weighs how far
the ends of beams are from the nearest wall, and passes over beams without an echo, which the tensor
counts. What it can tell at most is

    E = s / B  sum n n^T

over the beams with an echo, a share s of all B: n has the derivatives, by x, y and theta, of the
distance between a beam's end and the wall that it met, along the wall's normal. Of a Gaussian error
the sum is the Fisher information. The likelihood of a beam's end is bounded, though: a few echoes
do not tell particles apart that are spread out, hence s, with which forecasts agreed better with
drives.
"""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import dataclass

import numpy as np

from ambinav.geometry.environment import Environment
from ambinav.localization.expected_covariance import place_and_scanner
from ambinav.localization.information import NOBODY, beam_noise, informations, ray_caster
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.lattice_values import bilinear, corner
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints, Ints32
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.field import nearest_possible

# On a map with headings a scan is cast at each of them: with so many beams of each sensor a cell in
# all, evenly chosen and weighted up, the 760 000 poses of the demo take 10 s.
BEAMS_A_CELL = 2400
# Cells around one within walls, of which the nearest stands for it.
AROUND = 3


@dataclass(frozen=True, eq=False)
class InformationField:
    """Information matrix of one scan over a map, linear between cells, extended into walls.

    Attributes:
        nearest: Row of `entries` for each cell: its own, or that of the nearest one where a robot
            can be; int32, shape (rows, columns, headings), headings 1 if it does not matter.
        entries: xx, xy, yy (1/m^2), their couplings xt, yt with the heading (1/(m rad)), tt
            (1/rad^2), and the least information about the position over all directions if the
            heading is unknown (1/m^2); float32, shape (N, 7). With echoes shape (N, 13): xx, xy,
            yy (1), xt, yt (m), tt (m^2) of E follow.
        origin: x and y of the first cell's centre, metres.
        spacing: Metres.
    """

    nearest: Ints32
    entries: Floats32
    origin: tuple[float, float]
    spacing: float

    @classmethod
    def of(
        cls,
        amap: AmbiguityMap,
        environment: Environment | None = None,
        poses: Floats | None = None,
        *,
        echoes: bool = False,
    ) -> InformationField:
        """Compute it from a map, whose walls and scanner give the part about the heading.

        Args:
            amap: The map.
            environment: What it was built of; None: as the map keeps it, which of buildings in
                space is the floor alone.
            poses: Poses at which it is wanted, shape (N, 3), in less time; elsewhere it is that of
                the nearest cell computed. None: the whole map.
            echoes: Compute what echoes alone tell, too.

        Raises:
            InputError: the map does not tell its scanner, or by which parameters it was made.
        """
        data = amap.dataset
        possible = amap.possible
        if poses is not None:
            near = _near(amap, poses)
            possible = near if near.any() else possible
        headings = possible.shape[2]
        names = LAYERS + (TURNS if TURNS[0] in amap.layers else ())
        layers = {name: _as_headings(amap, name) for name in names}
        theta = data["theta"].values.astype(np.float64) if amap.has_theta else np.zeros(1)
        turning = _Turning(amap, environment)
        # Of a large building most cells are not floor: values are kept once for each pose.
        nearest = np.zeros(possible.shape, dtype=np.int32)
        columns = ECHOES + 6 if echoes else ECHOES
        entries = np.empty((np.count_nonzero(possible), columns), dtype=np.float32)
        done = 0
        for k in range(headings):
            # One heading at a time, so that only one floor is in memory.
            row, column = np.nonzero(possible[:, :, k])
            at = {
                name: values[row, column, min(k, values.shape[2] - 1)].astype(np.float64)
                for name, values in layers.items()
            }
            here = np.column_stack(
                [data["x"].values[column], data["y"].values[row], np.full(len(row), theta[k])]
            )
            turn, shift, ends = turning.at(here, echoes)
            if "heading" in at:
                turn = np.minimum(turn, _along(at["heading"], at["heading_radius"]))
            part = slice(done, done + len(row))
            nearest[row, column, k] = np.arange(part.start, part.stop)
            entries[part, :ECHOES] = np.column_stack(_entries(at, turn, shift))
            if echoes:
                entries[part, ECHOES:] = ends[:, *_UPPER]
            done = part.stop
        for k in range(headings):
            nearest[:, :, k] = nearest[nearest_possible(possible, k)]
        origin = (float(data["x"].values[0]), float(data["y"].values[0]))
        return cls(nearest, entries, origin, amap.spacing)

    @property
    def fields(self) -> tuple[Ints32, Floats32]:
        """Arrays that `information_at` reads."""
        return self.nearest, self.entries

    @property
    def has_echoes(self) -> bool:
        """True if it has what echoes alone tell."""
        return bool(self.entries.shape[1] > ECHOES)

    @property
    def weak(self) -> Floats32:
        """The least information about the position of each cell, 1/m^2, shaped as `nearest`."""
        return np.asarray(self.entries[self.nearest, 6])

    @property
    def lattice(self) -> tuple[float, float, float]:
        """Lattice for the kernels: x and y of the first cell, cells per metre."""
        return *self.origin, 1.0 / self.spacing

    def at(self, poses: Floats) -> Floats:
        """Return information matrices (x, y, theta) at poses of shape (N, 3), shape (N, 3, 3)."""
        out = np.empty((len(poses), 3, 3))
        run_rows(_at, len(poses), poses, self.fields, *self.lattice, out, least=256)
        return out


ECHOES = 7
"""Column of `InformationField.entries` at which those of the echoes begin."""
_UPPER = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)
LAYERS = ("major", "minor", "major_radius", "minor_radius", "direction")
TURNS = ("heading", "heading_radius")


def _as_headings(amap: AmbiguityMap, layer: str) -> Floats32:
    """Return a layer over (y, x, headings)."""
    values = amap.dataset[layer].values
    return np.asarray(values[:, :, np.newaxis] if values.ndim == 2 else values)


def _near(amap: AmbiguityMap, poses: Floats) -> Bools:
    """Return a mask, shaped as `possible`, of the cells that interpolation at poses may read.

    They are the corners that `matrix_at` reads, and what may stand for corners within walls.
    """
    possible = amap.possible
    rows, columns, headings = possible.shape
    corners, cells = np.zeros((2, *possible.shape), dtype=np.bool_)
    origin = [float(amap.dataset[axis].values[0]) for axis in ("x", "y")]
    last = np.array([columns, rows]) - 1
    place = np.clip((poses[:, :2] - origin) * (1.0 / amap.spacing), 0.0, last)
    column, row = place.astype(np.int64).T
    below = np.floor(poses[:, 2] * headings / (2.0 * math.pi)).astype(np.int64)
    for up, right, turn in itertools.product((0, 1), repeat=3):
        at = np.minimum(row + up, rows - 1), np.minimum(column + right, columns - 1)
        corners[*at, (below + turn) % headings] = True
    row, column, heading = np.nonzero(corners & ~possible)
    for up, right in itertools.product(range(-AROUND, AROUND + 1), repeat=2):
        at = np.clip(row + up, 0, rows - 1), np.clip(column + right, 0, columns - 1)
        cells[*at, heading] = True
    return np.asarray((corners | cells) & possible)


class _Turning:
    """Information of a scan about the heading, and its coupling with the position."""

    def __init__(self, amap: AmbiguityMap, building: Environment | None) -> None:
        map_environment, scanner = place_and_scanner(amap, None)
        if not amap.has_theta:
            # As the map is: else it would depend on where heading 0 is.
            scanner = scanner.centred
        environment = map_environment if building is None else building
        parameters = json.loads(amap.dataset.attrs["parameters"])
        for name in ("tau", "map_std", "beams", "beams_used"):
            if name not in parameters:
                raise InputError(
                    f"{amap.source}: its parameters lack {name}; make the map again with "
                    "`ambinav map`."
                )
        beams, weight = _thinned(scanner, amap.possible.shape[2])
        weight = weight * _used(scanner, parameters["beams_used"])[beams]
        self.weight = weight / weight.sum()
        self.share = 1.0 / (2.0 * parameters["tau"])
        self.cast = ray_caster(environment, scanner, beams)
        noise = beam_noise(environment, scanner, float(parameters["map_std"]))
        self.noise = noise._replace(
            near=noise.near[beams],
            far=noise.far[beams],
            bias=noise.bias[noise.row[beams]],
            variance=noise.variance[noise.row[beams]] / weight[:, np.newaxis],
            row=np.arange(len(beams)),
            steady=noise.steady[noise.row[beams]],
        )

    def at(self, poses: Floats, echoes: bool) -> tuple[Floats, Floats, Floats]:
        """Return h (1/rad^2), c (metres) and E at poses (N, 3).

        Shapes (N,), (N, 2) and, without `echoes`, (0, 3, 3), else (N, 3, 3).
        """
        matrices = np.empty((len(poses), 3, 3))
        ends = np.empty((len(poses) if echoes else 0, 3, 3))
        informations(
            np.ascontiguousarray(poses), self.cast, self.noise, matrices,
            self.weight if echoes else NOBODY, ends,
        )  # fmt: skip
        # Normals are unit vectors, so that the trace about x and y is s.
        ends *= (ends[:, 0, 0] + ends[:, 1, 1])[:, np.newaxis, np.newaxis]
        turn = matrices[:, 2, 2]
        # A scan that tells nothing of the heading has no coupling either.
        shift = np.divide(
            matrices[:, :2, 2], turn[:, np.newaxis], out=np.zeros((len(poses), 2)),
            where=turn[:, np.newaxis] > 0.0,
        )  # fmt: skip
        return self.share * turn, shift, ends


def _used(scanner: RangeScanner, beams_used: int) -> Floats:
    """Return how many beams of the map each beam of a scanner represents, shape (B,).

    The map's tau is of the beams that it was made with: all of a part of few beams, some of a part
    of many.
    """
    sizes = np.array([len(part.layout.mounts()) for part in scanner.parts])
    used = np.array([len(part.layout.mounts()) for part in scanner.thinned(beams_used).parts])
    share = used / sizes * (beams_used / used.sum())
    return np.asarray(np.repeat(share, sizes), dtype=np.float64)


def _thinned(scanner: RangeScanner, headings: int) -> tuple[Ints, Floats]:
    """Select beams to cast at each heading, and how many beams each of them represents."""
    chosen, weight = [], []
    most = max(BEAMS_A_CELL // headings, 1)
    for sensor in np.unique(scanner.sensor_of_beam):
        beams = np.flatnonzero(scanner.sensor_of_beam == sensor)
        every = 1 if headings == 1 else math.ceil(len(beams) / most)
        part = beams[every // 2 :: every]
        chosen.append(part)
        weight.append(np.full(len(part), len(beams) / len(part)))
    order = np.argsort(np.concatenate(chosen))
    return np.concatenate(chosen)[order].astype(np.int64), np.concatenate(weight)[order]


def _entries(at: dict[str, Floats], turn: Floats, shift: Floats) -> tuple[Floats, ...]:
    """Return the information's entries, shape (N,) each, and the least one about the position."""
    along = _along(at["major"], at["major_radius"])
    across = _along(at["minor"], at["minor_radius"])
    c, s = np.cos(at["direction"]), np.sin(at["direction"])
    x, y = shift.T
    return (
        c * c * along + s * s * across + turn * x * x,
        c * s * (along - across) + turn * x * y,
        s * s * along + c * c * across + turn * y * y,
        turn * x,
        turn * y,
        turn,
        np.minimum(along, across),
    )


def _along(ratio: Floats, radius: Floats) -> Floats:
    """Return the information along one axis of the tensor."""
    return np.asarray((1.0 - np.minimum(ratio, 1.0) ** 2) / np.maximum(radius, 1e-9) ** 2)


@kernel
def information_at(x, y, theta, fields, left, low, inverse, out):
    """Write the information matrix at a pose to `out`, shape (3, 3)."""
    matrix_at(x, y, theta, fields, left, low, inverse, 0, out)


@kernel
def matrix_at(x, y, theta, fields, left, low, inverse, first, out):
    """Write the matrix whose entries begin in column `first` at a pose, shape (3, 3)."""
    nearest, entries = fields
    rows, columns, headings = nearest.shape
    c, a = corner((x - left) * inverse, columns)
    r, b = corner((y - low) * inverse, rows)
    c1, r1 = min(c + 1, columns - 1), min(r + 1, rows - 1)
    w = theta * headings / (2.0 * math.pi)
    turn = math.floor(w)
    share = w - turn
    out[:] = 0.0
    for side in range(2 if headings > 1 else 1):
        t = (int(turn) + side) % headings
        weight = 1.0 if headings == 1 else (share if side else 1.0 - share)
        here, right = entries[nearest[r, c, t]], entries[nearest[r, c1, t]]
        above, across = entries[nearest[r1, c, t]], entries[nearest[r1, c1, t]]
        k = first
        for j in range(3):
            for i in range(j + 1):
                out[i, j] += weight * bilinear(here[k], right[k], above[k], across[k], a, b)
                k += 1
    out[1, 0], out[2, 0], out[2, 1] = out[0, 1], out[0, 2], out[1, 2]


@kernel
def _at(begin, end, poses, fields, left, low, inverse, out):
    for i in range(begin, end):
        information_at(poses[i, 0], poses[i, 1], poses[i, 2], fields, left, low, inverse, out[i])
