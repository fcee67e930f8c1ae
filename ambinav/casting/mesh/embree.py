"""Rays through Embree, in this process or in another one, whose program is this file too.

It imports nothing of ambinav, so that a process starts in a blink. Started as a script it maps the
mesh and the rays, which lie in memory that it shares with the one who started it, casts the pieces
that it is told on its standard input, and ends when that is closed: also when the other is killed.
"""

from __future__ import annotations

import mmap
import sys
from typing import Any, NamedTuple

import numpy as np

from ambinav.runtime.array_types import Floats32, Ints32

# Bytes of a ray in the shared memory: origin, direction, distance, face.
RAY_BYTES = 32


class RayBlock(NamedTuple):
    """Buffers for rays and their hits.

    Attributes:
        origin: float32, shape (N, 3), metres.
        direction: float32, shape (N, 3), of any length.
        distance: float32, shape (N,), in lengths of the direction; inf for none.
        face: int32, shape (N,), -1 for none.
    """

    origin: Floats32
    direction: Floats32
    distance: Floats32
    face: Ints32

    @classmethod
    def of(cls, buffer: Any, count: int) -> RayBlock:
        """Lay `count` rays over a buffer of `count` times `RAY_BYTES` bytes."""
        numbers = np.frombuffer(buffer, dtype=np.float32, count=8 * count)
        return cls(
            numbers[: 3 * count].reshape(count, 3),
            numbers[3 * count : 6 * count].reshape(count, 3),
            numbers[6 * count : 7 * count],
            numbers[7 * count :].view(np.int32),
        )


def scene_of(vertices: Floats32, faces: Ints32) -> Any:
    """Build Embree's scene from vertices, shape (V, 3), and faces of three indices, (F, 3)."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    TriangleMesh(scene, vertices, faces)
    return scene


def cast_piece(scene: Any, rays: RayBlock, low: int, high: int, reach: float) -> None:
    """Cast the rays `low` to `high` - 1 up to `reach`; write distance and face.

    Embree casts them one after the other, so that a ray does not depend on its neighbours.
    """
    part = slice(low, high)
    limit = np.full(high - low, reach, dtype=np.float32)
    hits = scene.run(rays.origin[part], rays.direction[part], limit, output=1)
    rays.face[part] = hits["primID"]
    rays.distance[part] = np.where(hits["primID"] >= 0, hits["tfar"], np.float32(np.inf))


def _serve(mesh: int, vertices: int, faces: int, block: int, count: int) -> None:
    """Cast the rays requested on standard input, one line each: first ray, end, reach."""
    with mmap.mmap(mesh, 12 * (vertices + faces)) as memory, mmap.mmap(block, 0) as shared:
        points = np.frombuffer(memory, dtype=np.float32, count=3 * vertices).reshape(-1, 3)
        corners = np.frombuffer(memory, dtype=np.int32, offset=12 * vertices).reshape(-1, 3)
        scene = scene_of(points.copy(), corners.copy())
        rays = RayBlock.of(shared, count)
        for line in sys.stdin:
            low, high, reach = line.split()
            cast_piece(scene, rays, int(low), int(high), float(reach))
            print(flush=True)
        # Memory maps cannot be closed while arrays use their buffers.
        del points, corners, rays


if __name__ == "__main__":
    _serve(*(int(word) for word in sys.argv[1:]))
