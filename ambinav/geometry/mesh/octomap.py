"""Read an OctoMap: occupied voxels of an octree as a mesh of their outer faces."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.mesh.mesh import Mesh
from ambinav.geometry.mesh.voxels import voxel_mesh
from ambinav.kernels import kernel

_MAGIC: Final = b"# Octomap OcTree binary file"
_DEPTH: Final = 16
# What two bits say of a child (Hornung et al. 2013, OctoMap 1.9: `readBinaryNode`).
_FREE, _OCCUPIED, _INNER = 1, 2, 3


class Leaves(NamedTuple):
    """Leaves of an octree.

    Attributes:
        key: Lowest voxel of each, int64, shape (L, 3), counted from the tree's lowest corner.
        size: Edge of each in voxels, int64, shape (L,).
        occupied: bool, shape (L,); the others are free.
    """

    key: NDArray[np.int64]
    size: NDArray[np.int64]
    occupied: NDArray[np.bool_]


def read_octomap(path: str | Path, *, processes: int = 1) -> Mesh:
    """Read a binary OctoMap (.bt) as the outer faces of its occupied voxels, metres, z up.

    Args:
        path: The file.
        processes: See `Mesh`.

    Raises:
        InputError: it is no binary OctoMap of a plain octree, it is cut off, or nothing in it is
            occupied.
    """
    path = Path(path)
    leaves, edge = read_leaves(path)
    voxels = _expanded(leaves.key[leaves.occupied], leaves.size[leaves.occupied])
    if not len(voxels):
        raise InputError(f"{path}: nothing in it is occupied; give a map of a building.")
    middle = 1 << (_DEPTH - 1)
    return voxel_mesh(voxels - middle, edge, name=path.stem, source=path, processes=processes)


def read_leaves(path: Path) -> tuple[Leaves, float]:
    """The leaves of a binary OctoMap, and the edge of a voxel in metres.

    Raises:
        InputError: see `read_octomap`.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: it cannot be read ({error.strerror}); give a .bt file."
        ) from error
    head, found, body = data.partition(b"\ndata\n")
    if not data.startswith(_MAGIC) or not found:
        raise InputError(
            f"{path}: it is no binary OctoMap; give a .bt file, as `octree.writeBinary` makes."
        )
    lines = [line.split(maxsplit=1) for line in head.decode("latin-1").splitlines()]
    fields = {line[0]: line[1] for line in lines if len(line) == 2 and line[0] != "#"}
    if fields.get("id") != "OcTree":
        raise InputError(f"{path}: id is {fields.get('id')!r}; only a plain OcTree can be read.")
    try:
        edge = float(fields["res"])
    except (KeyError, ValueError):
        edge = math.nan
    if not 0.0 < edge < math.inf:
        raise InputError(f"{path}: res is {fields.get('res')!r}; it must be metres above 0.")
    nodes = np.frombuffer(body[: len(body) // 2 * 2], dtype="<u2")
    # Every node has eight children at the most.
    key = np.empty((8 * len(nodes), 3), dtype=np.int64)
    size = np.empty(len(key), dtype=np.int64)
    occupied = np.empty(len(key), dtype=np.bool_)
    count = _walk(nodes, key, size, occupied)
    if count < 0:
        raise InputError(f"{path}: it is cut off or damaged; copy it again.")
    return Leaves(key[:count], size[:count], occupied[:count]), edge


@kernel
def _walk(nodes, key, size, occupied):
    """Follow the tree, depth first; how many leaves there are, -1 where the nodes do not fit."""
    at = np.zeros((_DEPTH + 1, 3), dtype=np.int64)
    rest = np.zeros(_DEPTH + 1, dtype=np.int64)
    child = np.zeros(_DEPTH + 1, dtype=np.int64)
    if nodes.size == 0:
        return -1
    rest[0] = nodes[0]
    read, leaves, depth = 1, 0, 0
    while depth >= 0:
        i = child[depth]
        if i == 8:
            depth -= 1
            continue
        child[depth] += 1
        kind = (rest[depth] >> (2 * i)) & 3
        if kind == 0:
            continue
        half = np.int64(1) << (_DEPTH - 1 - depth)
        x = at[depth, 0] + half * (i & 1)
        y = at[depth, 1] + half * ((i >> 1) & 1)
        z = at[depth, 2] + half * (i >> 2)
        if kind == _INNER:
            if read == nodes.size or depth + 1 == _DEPTH:
                return -1
            depth += 1
            at[depth, 0], at[depth, 1], at[depth, 2] = x, y, z
            rest[depth], child[depth] = nodes[read], 0
            read += 1
            continue
        key[leaves, 0], key[leaves, 1], key[leaves, 2] = x, y, z
        size[leaves] = half
        occupied[leaves] = kind == _OCCUPIED
        leaves += 1
    return leaves if read == nodes.size else -1


def _expanded(key: NDArray[np.int64], size: NDArray[np.int64]) -> NDArray[np.int64]:
    """The voxels of leaves, shape (V, 3)."""
    parts = [np.empty((0, 3), dtype=np.int64)]
    for edge in np.unique(size).tolist():
        inner = np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        parts.append((key[size == edge][:, None] + inner).reshape(-1, 3))
    return np.concatenate(parts)
