"""Voxels as a mesh of their outer faces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.array_types import Ints

# Corners of the face of a unit cube that looks along -x, -y, -z, x, y and z, counter-clockwise.
_FACES: Final = np.array(
    [
        [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0)],
        [(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1)],
        [(0, 0, 0), (0, 1, 0), (1, 1, 0), (1, 0, 0)],
        [(1, 0, 0), (1, 1, 0), (1, 1, 1), (1, 0, 1)],
        [(0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 1, 0)],
        [(0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)],
    ]
)
_LOOKS: Final = np.array([(-1, 0, 0), (0, -1, 0), (0, 0, -1), (1, 0, 0), (0, 1, 0), (0, 0, 1)])


def voxel_mesh(
    voxels: Ints,
    edge: float,
    *,
    shift: ArrayLike = 0.0,
    name: str,
    source: Path,
    processes: int = 1,
    notes: Sequence[str] = (),
    scanned: bool = False,
) -> Mesh:
    """Make a mesh of the voxel faces that no other voxel covers; they look outward.

    Args:
        voxels: Distinct, shape (V, 3) with V at least 1; voxel (i, j, k) reaches from (i, j, k)
            times `edge` on.
        edge: Edge of a voxel, metres.
        shift: By how much the whole is moved, metres, shape (3,).
        name: See `Mesh`.
        source: See `Mesh`.
        processes: See `Mesh`.
        notes: See `Mesh`.
        scanned: Whether they are those of points (`Mesh.voxel`).
    """
    # A row more at either side, for neighbours that are not there.
    low = voxels.min(axis=0) - 1
    size = np.ptp(voxels, axis=0) + 3
    # Three whole numbers as one, in the order of x, y and z: that of a sum is the sum of theirs.
    step = np.array((size[1] * size[2], size[2], 1))
    code = ((voxels - low) * step).sum(axis=1)
    taken = np.sort(code)
    quads = []
    for look, face in zip(_LOOKS @ step, _FACES @ step, strict=True):
        at = np.minimum(np.searchsorted(taken, code + look), len(taken) - 1)
        quads.append(code[taken[at] != code + look][:, None] + face)
    corner, index = np.unique(np.concatenate(quads), return_inverse=True)
    faces = index.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    upper_digits, z = np.divmod(corner, size[2])
    vertices = (np.stack([*np.divmod(upper_digits, size[1]), z], axis=1) + low) * edge + shift
    return Mesh(
        vertices,
        faces,
        name=name,
        source=source,
        processes=processes,
        notes=notes,
        voxel=edge if scanned else 0.0,
    )
