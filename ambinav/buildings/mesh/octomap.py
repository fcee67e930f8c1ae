"""Reader of OctoMaps: occupied voxels of an octree as a mesh of their outer faces."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambinav.buildings.mesh.frame import check_size, check_storey
from ambinav.buildings.mesh.voxels import voxel_mesh
from ambinav.buildings.plan_units import SMALLEST, metres_in
from ambinav.casting.mesh.mesh import Mesh
from ambinav.runtime.array_types import Bools, Ints
from ambinav.runtime.errors import InputError
from ambinav.runtime.kernels import kernel

_MAGIC: Final = b"# Octomap OcTree binary file"
_FULL_MAGIC: Final = b"# Octomap OcTree file"
# Bytes of a node in a full file by the tree's id (`writeData` of its nodes, OctoMap 1.9): the log
# odds of being occupied, colours, which are not read, and one that says which children follow.
_NODE_BYTES: Final = {"OcTree": 4 + 1, "ColorOcTree": 4 + 3 + 1}
_DEPTH: Final = 16
# What two bits say of a child (Hornung et al. 2013, OctoMap 1.9: `readBinaryNode`).
_FREE, _OCCUPIED, _INNER = 1, 2, 3
# Occupied ones: five times those of a building of 100 x 100 m with walls every few metres, at 5 cm.
_MOST_VOXELS: Final = 50_000_000


class Leaves(NamedTuple):
    """Leaves of an octree.

    Attributes:
        key: Lowest voxel of each, int64, shape (L, 3), counted from the tree's lowest corner.
        size: Edge of each in voxels, int64, shape (L,).
        occupied: bool, shape (L,); the others are free.
    """

    key: Ints
    size: Ints
    occupied: Bools


def read_octomap(path: str | Path, *, unit: str | None = None, processes: int = 1) -> Mesh:
    """Read an OctoMap (.bt, .ot) as the outer faces of its occupied voxels, metres, z up.

    Plain trees and those with colours, which are not looked at. In a full file (.ot) a leaf is
    occupied if it is so with a probability of one half or more.

    Args:
        path: The file.
        unit: Unit of its numbers, one of `plan_units.UNITS`; None: metres, as defined by OctoMap,
            where that makes a building.
        processes: See `Mesh`.

    Raises:
        InputError: it is no OctoMap, or of another kind of tree, it is cut off, nothing in it is
            occupied, or its unit has to be said.

    Warns:
        InputWarning: as metres its storey is high, as one is in feet.
    """
    path = Path(path)
    scale = metres_in(unit, str(path))
    leaves, edge = read_leaves(path)
    edge *= scale
    key, size = leaves.key[leaves.occupied], leaves.size[leaves.occupied]
    if not len(key):
        raise InputError(f"{path}: nothing in it is occupied; give a map of a building.")
    if (size**3).sum() > _MOST_VOXELS:
        raise InputError(
            f"{path}: a block of {size.max()} voxels of {edge:g} m in each direction is occupied, "
            "which no building has; it is damaged, or solid inside: make it of surfaces."
        )
    voxels = _expanded(key, size)
    middle = 1 << (_DEPTH - 1)
    mesh = voxel_mesh(
        voxels - middle, edge, name=path.stem, source=path, processes=processes, scanned=True
    )
    if unit is None:
        # That of a shelf alone is one too.
        extent = np.ptp(mesh.bounds, axis=0)
        if max(extent[:2]) >= SMALLEST:
            check_size(path, "OctoMap", extent)
        mesh.notes = (*mesh.notes, *check_storey(path, mesh))
    return mesh


def read_leaves(path: Path) -> tuple[Leaves, float]:
    """Read the leaves of an OctoMap, and the edge of a voxel in metres.

    Raises:
        InputError: see `read_octomap`.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(
            f"{path}: it cannot be read ({error.strerror}); give a .bt or .ot file."
        ) from error
    head, mark, body = data.partition(b"\ndata\n")
    is_full = data.startswith(_FULL_MAGIC)
    if not (is_full or data.startswith(_MAGIC)) or not mark:
        raise InputError(
            f"{path}: this is not an OctoMap; give a .bt or .ot file, as `octree.writeBinary` and "
            "`octree.write` make."
        )
    lines = [line.split(maxsplit=1) for line in head.decode("latin-1").splitlines()]
    fields = {line[0]: line[1] for line in lines if len(line) == 2 and line[0] != "#"}
    kind = fields.get("id", "")
    if kind not in _NODE_BYTES:
        raise InputError(
            f"{path}: id is {fields.get('id')!r}; it must be {' or '.join(_NODE_BYTES)}."
        )
    try:
        edge = float(fields["res"])
    except (KeyError, ValueError):
        edge = math.nan
    if not 0.0 < edge < math.inf:
        raise InputError(f"{path}: res is {fields.get('res')!r}; it must be metres above 0.")
    if is_full:
        nodes = _binary_nodes(body, _NODE_BYTES[kind])
    else:
        nodes = np.frombuffer(body[: len(body) // 2 * 2], dtype="<u2")
    # Every node has eight children at the most.
    key = np.empty((8 * len(nodes), 3), dtype=np.int64)
    size = np.empty(len(key), dtype=np.int64)
    occupied = np.empty(len(key), dtype=np.bool_)
    count = _walk(nodes, key, size, occupied)
    if count < 0:
        raise InputError(f"{path}: it is cut off or damaged; copy it again.")
    return Leaves(key[:count], size[:count], occupied[:count]), edge


def _binary_nodes(body: bytes, size: int) -> NDArray[np.uint16]:
    """Convert nodes of a full file to those of a binary one; none if they are cut off."""
    if len(body) % size or not body:
        return np.empty(0, dtype=np.uint16)
    table = np.frombuffer(body, dtype=np.uint8).reshape(-1, size)
    odds = np.ascontiguousarray(table[:, :4]).view("<f4")[:, 0]
    nodes = np.zeros(len(table), dtype=np.uint16)
    count = _fold(np.ascontiguousarray(table[:, -1]), odds >= 0.0, nodes)
    return nodes[:count]


@kernel
def _fold(children, occupied, nodes):
    """Write inner nodes with the kinds of their children; return their number, 0 on an error.

    Args:
        children: Children of every node, depth first, bit k for child k, uint8, shape (N,).
        occupied: Whether each node is occupied, bool, shape (N,).
        nodes: Written, uint16, shape (N,).
    """
    if children[0] == 0:
        return 0
    owner = np.zeros(_DEPTH + 1, dtype=np.int64)
    remaining = np.zeros(_DEPTH + 1, dtype=np.int64)
    remaining[0] = children[0]
    count, depth = 1, 0
    for k in range(1, len(children)):
        while depth >= 0 and remaining[depth] == 0:
            depth -= 1
        if depth < 0:
            return 0
        i = 0
        while (remaining[depth] >> i) & 1 == 0:
            i += 1
        remaining[depth] &= remaining[depth] - 1
        kind = _OCCUPIED if occupied[k] else _FREE
        if children[k] != 0:
            kind = _INNER
        nodes[owner[depth]] |= np.uint16(kind << (2 * i))
        if children[k] != 0:
            if depth + 1 == _DEPTH:
                return 0
            depth += 1
            owner[depth], remaining[depth] = count, children[k]
            count += 1
    while depth >= 0 and remaining[depth] == 0:
        depth -= 1
    return count if depth < 0 else 0


@kernel
def _walk(nodes, key, size, occupied):
    """Walk the tree depth first; return the number of leaves, -1 if the nodes do not fit."""
    at = np.zeros((_DEPTH + 1, 3), dtype=np.int64)
    remaining = np.zeros(_DEPTH + 1, dtype=np.int64)
    child = np.zeros(_DEPTH + 1, dtype=np.int64)
    if nodes.size == 0:
        return -1
    remaining[0] = nodes[0]
    read, leaves, depth = 1, 0, 0
    while depth >= 0:
        i = child[depth]
        if i == 8:
            depth -= 1
            continue
        child[depth] += 1
        kind = (remaining[depth] >> (2 * i)) & 3
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
            remaining[depth], child[depth] = nodes[read], 0
            read += 1
            continue
        key[leaves, 0], key[leaves, 1], key[leaves, 2] = x, y, z
        size[leaves] = half
        occupied[leaves] = kind == _OCCUPIED
        leaves += 1
    return leaves if read == nodes.size else -1


def _expanded(key: Ints, size: Ints) -> Ints:
    """Return the voxels of leaves, shape (V, 3)."""
    parts = [np.empty((0, 3), dtype=np.int64)]
    for edge in np.unique(size).tolist():
        inner = np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        parts.append((key[size == edge][:, None] + inner).reshape(-1, 3))
    return np.concatenate(parts)
