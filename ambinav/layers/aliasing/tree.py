"""Signatures in scipy's k-d tree, arranged for a kernel to walk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from ambinav.layers.aliasing.signature import Signatures
from ambinav.runtime.array_types import Bytes, Indices, Ints, Ints32

LEAF = 16
LANES = 32
"""Lanes that are counted side by side: those of a vector register. Where a pose has no turns to
fill them with, a block holds this many poses."""


@dataclass(frozen=True, eq=False)
class Tree:
    """Hypotheses (pose q, turn k) in blocks of W lanes, the blocks in the leaves of a k-d tree.

    A signature bounds a box (low, high) over the levels, and what is sought are the boxes that
    hold a point: no query that cKDTree answers itself. So it divides the boxes' centres, and its
    nodes, with the bounds of all boxes below them, are walked by the kernel. Nodes are numbered in
    the order of that walk.

    Attributes:
        skip: Node that follows when a node's descendants are left out, int32, shape (M,).
        first: First block of a leaf, else 0, int32, shape (M,).
        last: One past its last block, else 0: an inner node, int32, shape (M,).
        node_low: Least low(l) below each node, int16, shape (M, S).
        node_high: Largest high(l) below each node, int16, shape (M, S).
        block_low: The same of each block, int16, shape (G, S).
        block_high: The same of each block, int16, shape (G, S).
        low: Interval beginnings, uint8, shape (G, width): those that meet beam b of p, one a lane,
            begin at offset[b].
        width: End less beginning of each interval, in the same places.
        offset: int64, shape (B,).
        pose: q of each lane, -1 for padding, int32, shape (G, W), W a multiple of `LANES`.
        turn: k of each lane, int32, shape (W,).
    """

    skip: Ints32
    first: Ints32
    last: Ints32
    node_low: NDArray[np.int16]
    node_high: NDArray[np.int16]
    block_low: NDArray[np.int16]
    block_high: NDArray[np.int16]
    low: Bytes
    width: Bytes
    offset: Ints
    pose: Ints32
    turn: Ints32

    @classmethod
    def over(cls, signatures: Signatures, poses: Indices, turns: int) -> Tree:
        """Build a tree over the given poses, at least one.

        Args:
            signatures: Signatures of all poses.
            poses: Those to be found, shape (Q,).
            turns: n, see `Scans`.
        """
        bottom, top = signatures.low_above[poses], signatures.high_above[poses]
        size = LEAF if turns > 1 else LANES
        tree = cKDTree(0.5 * (bottom + top.astype(np.float64)), leafsize=size)
        nodes = _walk(tree.tree)
        groups: list[Indices] = []
        skip, first, last = [], [], []
        span = 1 if turns > 1 else LANES
        for node, after in nodes:
            begin = len(groups)
            if node.split_dim == -1:
                members = tree.indices[node.start_idx : node.end_idx]
                groups += [members[i : i + span] for i in range(0, len(members), span)]
            skip.append(after)
            first.append(begin)
            last.append(len(groups) if node.split_dim == -1 else 0)
        pieces = [tree.indices[node.start_idx : node.end_idx] for node, _ in nodes]
        lanes = -(-turns // LANES) * LANES
        lay = _doubled if turns > 1 else _side_by_side
        pose = np.full((len(groups), lanes), -1, dtype=np.int32)
        for g, group in enumerate(groups):
            pose[g, : turns if turns > 1 else len(group)] = poses[group]
        beams = np.arange(signatures.code.shape[1])
        return cls(
            skip=np.array(skip, dtype=np.int32),
            first=np.array(first, dtype=np.int32),
            last=np.array(last, dtype=np.int32),
            node_low=np.stack([bottom[piece].min(axis=0) for piece in pieces]),
            node_high=np.stack([top[piece].max(axis=0) for piece in pieces]),
            block_low=np.stack([bottom[group].min(axis=0) for group in groups]),
            block_high=np.stack([top[group].max(axis=0) for group in groups]),
            low=lay(signatures.low, pose, turns),
            width=lay(signatures.high - signatures.low, pose, turns),
            offset=beams // turns * 2 * turns + beams % turns if turns > 1 else beams * LANES,
            pose=pose,
            turn=np.arange(lanes, dtype=np.int32) % turns,
        )


def _walk(root: Any) -> list[tuple[Any, int]]:
    """List nodes before their descendants, each with the index of the node after these."""
    nodes: list[tuple[Any, int]] = []

    def visit(node: Any) -> None:
        place = len(nodes)
        nodes.append((node, 0))
        if node.split_dim != -1:
            visit(node.lesser)
            visit(node.greater)
        nodes[place] = (node, len(nodes))

    visit(root)
    return nodes


def _doubled(values: Bytes, pose: Ints32, turns: int) -> Bytes:
    """Repeat each orbit twice in a row, so that n turns of a beam are contiguous; (G, 2 B + W)."""
    orbits = values[pose[:, 0]].reshape(len(pose), -1, turns)
    twice = np.concatenate([orbits, orbits], axis=2).reshape(len(pose), -1)
    # The lanes beyond n read on; nobody looks at what they count.
    return np.pad(twice, ((0, 0), (0, pose.shape[1])))


def _side_by_side(values: Bytes, pose: Ints32, turns: int) -> Bytes:
    """Arrange beam after beam, of all poses of a block; (G, B LANES)."""
    return np.ascontiguousarray(values[pose].transpose(0, 2, 1).reshape(len(pose), -1))
