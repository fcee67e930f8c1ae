"""Many scanners at the same poses: each is a window of one panorama of returns.

A beam is what a sensor returns from a point along a direction. Two scanners that share these
share the beam, whichever way the robot faces and wherever in their fans it lies. So the beams of
all of them are cast once, and what one scanner sees are columns copied out.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.model import AmbiguityModel
from ambinav.ambiguity.neighbourhoods import Neighbourhoods
from ambinav.ambiguity.returns import SAME_RAY, panorama_returns
from ambinav.ambiguity.tensor import relative_radii
from ambinav.geometry.lattice import Lattice
from ambinav.geometry.morton import morton
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints
from ambinav.runtime.kernels import kernel
from ambinav.runtime.lanes import LANES
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.sensor import RangeSensor

Numbers = NDArray[np.intp]

# Beams of one panorama at the most, unless a single view has more.
MOST_BEAMS: Final = 2048
# Bytes of a panorama's returns that are held at a time.
TILE_BYTES: Final = 128_000_000
# A tile of so few poses is not divided further.
TILE_POSES: Final = 16


@dataclass(frozen=True, eq=False)
class View:
    """Scanner at one heading of the robot.

    Attributes:
        scanner: The beams that take part.
        heading: Heading of the robot, radians.
        tau: See `AmbiguityModel`.
        standing: Which column of the possible poses holds for it.
    """

    scanner: RangeScanner
    heading: float
    tau: float
    standing: int = 0


@dataclass(frozen=True, eq=False)
class Row:
    """Views with the same beams at every pose.

    Attributes:
        views: Their running numbers, ascending.
        columns: Their beams, in order, among those of the panorama.
    """

    views: tuple[int, ...]
    columns: Numbers


@dataclass(frozen=True, eq=False)
class Panorama:
    """Beams of several views, each beam once.

    Attributes:
        scanner: These beams, in the frame of a robot at heading 0.
        rows: Where each view finds its own.
    """

    scanner: RangeScanner
    rows: tuple[Row, ...]


def panoramas(views: Sequence[View], most: int) -> list[Panorama]:
    """Group views into panoramas, in order: each one takes views until it is full.

    Args:
        views: V views; those that share beams had best be neighbours.
        most: Beams of a panorama, unless a single view has more.
    """
    sensors: dict[RangeSensor, int] = {}
    keys, mounts = [], []
    for view in views:
        mount, key = view_beams(view, sensors)
        mounts.append(np.column_stack([mount, view.scanner.upright]))
        keys.append(key)
    ends = np.cumsum([len(key) for key in keys])
    _, first, beam = np.unique(np.concatenate(keys), axis=0, return_index=True, return_inverse=True)
    table = np.concatenate(mounts)[first], np.concatenate(keys)[first, 0]
    beams_of = np.split(beam.ravel(), ends[:-1])
    groups, begin, is_cast = [], 0, np.zeros(len(first), dtype=np.bool_)
    for i in range(len(views) + 1):
        full = i == len(views) or is_cast.sum() + (~is_cast[beams_of[i]]).sum() > most
        if full and i > begin:
            groups.append(_panorama(range(begin, i), views, beams_of, tuple(sensors), table))
            begin, is_cast = i, np.zeros_like(is_cast)
        if i < len(views):
            is_cast[beams_of[i]] = True
    return groups


def view_radii(
    lattice: Lattice, possible: Bools, point: Ints, views: Sequence[View], model: AmbiguityModel
) -> Iterator[tuple[tuple[int, ...], Numbers, Floats, Floats]]:
    """Yield the ambiguity of poses for each view, as `build_map` computes it for that scanner.

    Piece by piece within `TILE_BYTES` of returns; all pieces are as long to compute.

    Args:
        lattice: N free points, as `standing_lattice` gives them.
        possible: Whether the robot can stand there, shape (N, S).
        point: Running numbers of the points that are wanted, each once, shape (K,).
        views: The views.
        model: The parameters; each view has its own tau.

    Yields:
        Running numbers of views; which of the K points they are, shape (M,); and there for each of
        these views the radii `major` and `minor` over those of the free neighbourhood, shape (M,),
        nan where the pose is impossible.
    """
    first, column = _distinct(possible)
    views = [replace(view, standing=column[view.standing]) for view in views]
    possible = possible[:, first]
    every = panoramas(views, MOST_BEAMS)
    noise = model.map_std, model.outlier_share, lattice.environment.has_reflectors
    tables = [BeamTable.of(panorama.scanner, *noise) for panorama in every]
    subsets: dict[RangeScanner, BeamTable] = {}
    for panorama, table in zip(every, tables, strict=True):
        for row in panorama.rows:
            scanner = views[row.views[0]].scanner
            if scanner not in subsets:
                subsets[scanner] = table.subset(row.columns)
    width = max(len(table.limit) for table in tables)
    order = np.empty(len(lattice.rows_columns), dtype=np.intp)
    order[point] = np.arange(len(point))
    for around in _tiles(lattice, possible, point, model.radius, 20 * width):
        x, y = around.lattice.points
        at = order[around.among[around.poses]]
        buffer = np.empty(len(x) * 5 * width, dtype=np.float32)
        for panorama, table in zip(every, tables, strict=True):
            data = buffer[: len(x) * 5 * len(table.limit)].reshape(1, len(x), 5, -1)
            panorama_returns(lattice.environment, panorama.scanner, table, x, y, np.zeros(1), data)
            for row in panorama.rows:
                view = views[row.views[0]]
                its = subsets[view.scanner]
                radii = relative_radii(
                    _at_heading(around, view.standing).sums(
                        _copied(data, table.columns_of(row.columns)),
                        its,
                        replace(model, tau=view.tau),
                    )[:, 0]
                )
                yield row.views, at, radii["major"], radii["minor"]


def view_beams(view: View, sensors: dict[RangeSensor, int]) -> tuple[Floats, Ints]:
    """Return mounts of a view's beams at heading 0, (B, 3), and keys that identify them, (B, 6)."""
    x, y, yaw = view.scanner.mounts.T
    c, s = math.cos(view.heading), math.sin(view.heading)
    mounts = np.column_stack([c * x - s * y, s * x + c * y, yaw + view.heading])
    sensor = np.array([sensors.setdefault(part, len(sensors)) for part in view.scanner.sensors])
    sensor_of_beam = sensor[view.scanner.sensor_of_beam]
    turn = 2.0 * math.pi
    keys = np.rint(np.column_stack([mounts[:, :2], mounts[:, 2] % turn]) / SAME_RAY)
    # Just below a whole turn is none.
    keys[:, 2] %= round(turn / SAME_RAY)
    up = np.rint(view.scanner.upright / SAME_RAY)
    return mounts, np.column_stack([sensor_of_beam, np.hstack([keys, up]).astype(np.int64)])


def _panorama(
    numbers: range,
    views: Sequence[View],
    beams_of: Sequence[Numbers],
    sensors: tuple[RangeSensor, ...],
    table: tuple[Floats, Ints],
) -> Panorama:
    """Build the panorama of the views with these indices.

    Beams stand in the order in which the views use them: what is copied out of the returns for
    one view lies side by side, which takes a quarter of the time.
    """
    used, first = np.unique(np.concatenate([beams_of[i] for i in numbers]), return_index=True)
    used = used[np.argsort(first)]
    column = np.empty(len(table[0]), dtype=np.intp)
    column[used] = np.arange(len(used))
    rows: dict[object, tuple[list[int], Numbers]] = {}
    for i in numbers:
        columns = column[beams_of[i]]
        same = columns.tobytes(), views[i].tau, views[i].standing
        rows.setdefault(same, ([], columns))[0].append(i)
    beams = table[0][used]
    scanner = RangeScanner.from_mounts(
        sensors, beams[:, :3], table[1][used], upright=beams[:, 3:], name="panorama"
    )
    return Panorama(scanner, tuple(Row(tuple(i), columns) for i, columns in rows.values()))


def _distinct(possible: Bools) -> tuple[list[int], list[int]]:
    """Return the distinct columns, and the index of its distinct column for each column."""
    numbering: dict[bytes, int] = {}
    numbers = [numbering.setdefault(column.tobytes(), len(numbering)) for column in possible.T]
    return [numbers.index(i) for i in range(len(numbering))], numbers


def _tiles(
    lattice: Lattice, possible: Bools, point: Ints, radius: float, bytes_per_pose: int
) -> Iterator[Neighbourhoods]:
    """Yield compact groups of poses, with their neighbours."""
    clusters = [point[np.argsort(morton(lattice.rows_columns[point]), kind="stable")]]
    while clusters:
        cluster = clusters.pop()
        chosen = np.zeros(len(lattice.rows_columns), dtype=np.bool_)
        chosen[cluster] = True
        around = Neighbourhoods.around(lattice, possible, chosen, radius)
        if len(cluster) > TILE_POSES and len(around.among) * bytes_per_pose > TILE_BYTES:
            clusters += [cluster[len(cluster) // 2 :], cluster[: len(cluster) // 2]]
        else:
            yield around


def _at_heading(around: Neighbourhoods, column: int) -> Neighbourhoods:
    """Return the same for one heading only."""
    pick = slice(column, column + 1)
    return replace(around, possible=around.possible[:, pick], links=around.links[pick])


def _copied(data: Floats32, columns: Numbers) -> Floats32:
    """Copy columns of the returns (1, N, 5, P), with finite padding, to (1, N, 5, P')."""
    padded = np.pad(columns, (0, -len(columns) % LANES), mode="edge")
    out = np.empty((*data.shape[:3], len(padded)), dtype=np.float32)
    run_rows(_copy, data.shape[1], data, padded, out, least=256)
    return out


@kernel
def _copy(low, high, data, columns, out):
    for n in range(low, high):
        for row in range(data.shape[2]):
            for b in range(columns.size):
                out[0, n, row, b] = data[0, n, row, columns[b]]
