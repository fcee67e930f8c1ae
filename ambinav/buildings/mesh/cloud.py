"""Reader of point clouds: voxels with enough points, as a mesh of their outer faces."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ambinav.buildings.mesh.cloud_scans import e57_points, las_points
from ambinav.buildings.mesh.cloud_tables import (
    pcd_points,
    ply_points,
    ply_without_faces,
    text_points,
)
from ambinav.buildings.mesh.frame import (
    check_axis,
    check_size,
    check_storey,
    check_upright,
    turned_up,
)
from ambinav.buildings.mesh.level import levelled_note, upright, voxel_slope
from ambinav.buildings.mesh.voxels import voxel_mesh
from ambinav.buildings.plan_units import LARGEST, UNITS, metres_in
from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.errors import InputError

Points = NDArray[np.float64]
Whole = NDArray[np.int64]

SUFFIXES: Final = (".e57", ".las", ".laz", ".pcd", ".txt", ".xyz")
"""The suffixes of files that hold points alone; a .ply may."""
VOXEL: Final = 0.05
"""Edge of the voxels unless another is given, metres."""
MOST_VOXELS: Final = 20_000_000
"""More are not held in memory."""

# Voxels are counted within so many of the first point's, along each axis.
_REACH: Final = 1 << 20
_SPAN: Final = 2 * _REACH
# Numbers of voxels beyond this are no 64-bit integers.
_FARTHEST: Final = 2.0**62
# A building that lies farther from the origin is moved to it, metres.
_FAR: Final = 1000.0


def is_cloud(path: Path) -> bool:
    """Return whether `read_cloud` reads a file: by its suffix, or a .ply without faces."""
    suffix = path.suffix.lower()
    return suffix in SUFFIXES or (suffix == ".ply" and ply_without_faces(path))


def read_cloud(
    path: str | Path,
    *,
    voxel: float = VOXEL,
    points: int = 1,
    unit: str | None = None,
    up: str | None = None,
    processes: int = 1,
) -> Mesh:
    """Read LAS, LAZ, E57, PCD, a PLY without faces, or text with x, y and z in each line.

    A tilted floor is levelled (`level.voxel_slope`), for which the file is read a second time.
    Colours and intensities are not read. Files are read a million points at a time; but for those
    of a packed PCD only the voxels are held.

    Args:
        path: The file; its suffix determines the format.
        voxel: Edge of the voxels, metres; they lie at its multiples.
        points: A voxel with fewer is left out, against stray points.
        unit: What its numbers are in, one of `plan_units.UNITS`; None: metres, where that makes a
            building.
        up: The axis that is up, "x", "y" or "z"; None: z, where it does not look otherwise.
        processes: See `Mesh`.

    Returns:
        The outer faces of the voxels, in metres, z up. Its `notes` say what was left out, and by
        how many whole metres a building was moved that lay more than a kilometre off the origin.

    Raises:
        InputError: it cannot be read, is cut off or holds no point, a package is missing, no voxel
            or too many hold enough points, or its unit or upward axis has to be said.

    Warns:
        InputWarning: as metres its storey is high, as one is in feet.
    """
    path = Path(path)
    scale = metres_in(unit, str(path))
    check_axis(path, up)
    if not 0.0 < voxel < np.inf:
        raise InputError(f"{path}: voxel is {voxel}; give metres above 0, e.g. 0.05.")
    if points < 1:
        raise InputError(f"{path}: points is {points}; give at least 1.")
    if not is_cloud(path) and path.suffix.lower() != ".ply":
        raise InputError(
            f"{path}: the suffix {path.suffix or '(none)'} names no format of points; give one of "
            f"{', '.join(SUFFIXES)} or .ply."
        )
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give the path of a point cloud.")
    notes: list[str] = []
    counter = _VoxelCounter(path, scale / voxel, voxel if unit is None else 0.0)
    for chunk in _checked(path, _chunks(path, notes, unit)):
        counter.add(chunk)
    keys = turned_up(counter.voxels(points), up or "z")
    slope = voxel_slope(keys)
    if slope is not None:
        # Points are turned, not voxels, so a file is read again.
        middle = (keys.min(axis=0) + keys.max(axis=0) + 1) * (voxel / scale / 2.0)
        turn = upright(slope).T
        counter = _VoxelCounter(path, scale / voxel, voxel if unit is None else 0.0)
        for chunk in _checked(path, _chunks(path, [], unit)):
            counter.add((turned_up(chunk, up or "z") - middle) @ turn + middle)
        keys = counter.voxels(points)
        notes.append(levelled_note(str(path), slope))
    if unit is None:
        check_size(path, "point cloud", (np.ptp(keys, axis=0) + 1) * voxel)
    low = np.floor(keys.min(axis=0) * voxel)
    shift = np.where(np.abs(low) > _FAR, 0.0 - low, 0.0)
    notes.append(counter.summary(points, len(keys), voxel))
    if shift.any():
        x, y, z = shift.tolist()
        notes.append(f"{path}: moved by ({x:.0f}, {y:.0f}, {z:.0f}) m to the origin.")
    mesh = voxel_mesh(
        keys, voxel, shift=shift, name=path.stem, source=path, processes=processes, notes=notes,
        scanned=True,
    )  # fmt: skip
    if up is None:
        check_upright(path, mesh)
    if unit is None:
        mesh.notes = (*mesh.notes, *check_storey(path, mesh))
    return mesh


def _chunks(path: Path, notes: list[str], unit: str | None) -> Iterator[Points]:
    """Yield points, shape (n, 3) at a time, in the numbers of the file."""
    suffix = path.suffix.lower()
    if suffix in (".las", ".laz"):
        return las_points(path, notes, unit)
    read = {".e57": e57_points, ".pcd": pcd_points, ".ply": ply_points}.get(suffix, text_points)
    return read(path, notes)


def _checked(path: Path, chunks: Iterator[Points]) -> Iterator[Points]:
    """Yield the same; convert the errors that a broken file causes to `InputError`."""
    try:
        yield from chunks
    except (InputError, MemoryError):
        raise
    except OSError as error:
        raise InputError(f"{path}: it cannot be read ({error.strerror or error}).") from error
    except Exception as error:  # packages raise many kinds of errors for damaged files
        raise InputError(
            f"{path}: it cannot be read as {path.suffix[1:].upper()} ({type(error).__name__}: "
            f"{str(error).partition(chr(10))[0].rstrip()}); copy or export it again."
        ) from error


class _VoxelCounter:
    """Counter of the points in each voxel.

    Args:
        path: The file that they are from.
        per_unit: Voxels in one unit of its numbers.
        edge: Edge of a voxel as metres, where that they are is to be checked; else 0.
    """

    def __init__(self, path: Path, per_unit: float, edge: float) -> None:
        self.path, self.per_unit, self.edge = path, per_unit, edge
        self.code: Whole = np.empty(0, dtype=np.int64)
        self.count: Whole = np.empty(0, dtype=np.int64)
        self.seen = self.odd = 0
        self.first: Whole | None = None
        self.low, self.high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, points: Points) -> None:
        """Count points, shape (n, 3); raises `InputError` if there are too many voxels."""
        fine = np.isfinite(points).all(axis=1)
        self.seen += len(points)
        self.odd += len(points) - int(fine.sum())
        cells = np.floor(points[fine] * self.per_unit)
        if not len(cells):
            return
        low, high = cells.min(axis=0), cells.max(axis=0)
        self.low, self.high = np.minimum(self.low, low), np.maximum(self.high, high)
        self._check_span()
        if self.first is None:
            self.first = low.astype(np.int64) - _REACH
        keys = cells.astype(np.int64) - self.first
        code = (keys[:, 0] * _SPAN + keys[:, 1]) * _SPAN + keys[:, 2]
        here, count = np.unique(code, return_counts=True)
        both = np.concatenate([self.code, here])
        # Two sorted runs are merged.
        order = np.argsort(both, kind="stable")
        both = both[order]
        start = np.flatnonzero(np.diff(both, prepend=-1))
        self.code = both[start]
        self.count = np.add.reduceat(np.concatenate([self.count, count])[order], start)
        if len(self.code) > MOST_VOXELS:
            raise InputError(
                f"{self.path}: its points lie in more than {MOST_VOXELS // 10**6} million voxels; "
                "give larger ones with voxel, or, if its numbers are not metres, their unit."
            )

    def _check_span(self) -> None:
        size = self.high - self.low + 1.0
        if self.edge and max(size) * self.edge > LARGEST:
            check_size(self.path, "point cloud", size * self.edge)
            raise InputError(
                f"{self.path}: the point cloud is {max(size) * self.edge:.4g} m high, more than a "
                f"building is; say with --unit whether its numbers are {', '.join(UNITS)}."
            )
        if max(*abs(self.low), *abs(self.high)) >= _FARTHEST:
            raise InputError(
                f"{self.path}: its points lie farther from the origin than can be counted; move "
                "them nearer to it, or leave strays out."
            )
        if max(size) >= _REACH:
            raise InputError(
                f"{self.path}: its points lie {max(size):.3g} voxels apart, more than can be "
                "counted; leave stray points out, or give larger ones with voxel."
            )

    def voxels(self, points: int) -> Whole:
        """Return voxels with enough points, shape (V, 3), in multiples of their edge.

        Raises:
            InputError: there is none.
        """
        if self.first is None:
            fault = f"none of its {self.seen} points is finite" if self.seen else "it has no points"
            raise InputError(f"{self.path}: {fault}; export it again.")
        code = self.code[self.count >= points]
        if not len(code):
            raise InputError(
                f"{self.path}: no voxel holds {points} of its {self.seen} points; ask for fewer "
                "with points, or give larger voxels."
            )
        upper_digits, z = np.divmod(code, _SPAN)
        return np.stack([*np.divmod(upper_digits, _SPAN), z], axis=1) + self.first

    def summary(self, points: int, voxels: int, voxel: float) -> str:
        """Summarize in one sentence how the points became voxels."""
        text = f"{self.path}: {self.seen - self.odd} points in {voxels} voxels of {voxel:g} m"
        if voxels < len(self.code):
            text += f"; {len(self.code) - voxels} voxels with fewer than {points} points left out"
        if self.odd:
            text += f"; {self.odd} points that are not finite left out"
        return f"{text}."
