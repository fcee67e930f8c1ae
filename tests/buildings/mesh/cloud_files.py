"""Point clouds of a room, and writers of the formats that hold them."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.geometry.furnished import TABLES

Points = NDArray[np.float64]

# Halves of powers of two: float32, float64 and whole numbers hold them alike.
GRAIN = 1.0 / 1024.0
SIZE = np.array((6.0, 4.0, 2.5))


def faces_of(low: Any, high: Any, per_metre: int, rng: np.random.Generator) -> Points:
    """Points on the surface of a box, so many on a metre squared."""
    low, high = np.array(low), np.array(high)
    parts = []
    for axis in range(3):
        area = float(np.prod(np.delete(high - low, axis)))
        for side in (low, high):
            some = low + rng.random((math.ceil(per_metre * area), 3)) * (high - low)
            some[:, axis] = side[axis]
            parts.append(some)
    return np.concatenate(parts)


def room(per_metre: int = 4000) -> Points:
    """Points on floor, ceiling and walls of the furnished room, and on its furniture."""
    rng = np.random.default_rng(1)
    every = [faces_of((0, 0, 0), SIZE, per_metre, rng)]
    every += [faces_of(low, high, per_metre, rng) for low, high in TABLES]
    found = np.round(np.concatenate(every) / GRAIN) * GRAIN
    # No scanner sees what is in the cupboard, and under it.
    (x0, y0, _), (x1, y1, top) = TABLES[1]
    x, y, z = found.T
    hidden = (x > x0 + GRAIN) & (x < x1 - GRAIN) & (y > y0 + GRAIN) & (y < y1 - GRAIN)
    return np.asarray(found[~(hidden & (z < top - GRAIN))])


def write_las(path: Path, points: Points) -> None:
    laspy = pytest.importorskip("laspy", reason="laspy is not installed")
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales = np.full(3, GRAIN / 2.0)
    header.offsets = np.floor(points.min(axis=0))
    found = laspy.LasData(header)
    found.x, found.y, found.z = points.T
    found.red[:] = 7
    found.write(str(path))


def write_e57(path: Path, points: Points) -> None:
    """In two scans, of which one is turned by a right angle and moved."""
    pye57 = pytest.importorskip("pye57", reason="pye57 is not installed")
    half = len(points) // 2
    first, second = points[:half], points[half:]
    # The inverse of a turn about z, and of a move.
    local = np.stack([second[:, 1] - 2.0, 1.0 - second[:, 0], second[:, 2] + 3.0], axis=1)
    turn = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    with pye57.E57(str(path), mode="w") as file:
        for some, pose in ((first, (None, None)), (local, (turn, np.array([1.0, 2.0, -3.0])))):
            data = {f"cartesian{a}": some[:, k].copy() for k, a in enumerate("XYZ")}
            data["intensity"] = np.ones(len(some), dtype=np.float32)
            file.write_scan_raw(data, rotation=pose[0], translation=pose[1])


def write_text(path: Path, points: Points) -> None:
    lines = [f"{x:.10f}, {y:.10f}, {z:.10f}, 255, 0, 0" for x, y, z in points]
    path.write_text("//X,Y,Z,R,G,B\n" + "\n".join(lines) + "\n")


def write_xyz(path: Path, points: Points) -> None:
    np.savetxt(path, points, fmt="%.10f")


def write_ply(path: Path, points: Points, order: str = "little") -> None:
    mark = "<" if order == "little" else ">"
    rows = np.zeros(len(points), [("c", "u1"), *((a, f"{mark}f4") for a in "xyz")])
    for k, axis in enumerate("xyz"):
        rows[axis] = points[:, k]
    head = f"ply\nformat binary_{order}_endian 1.0\nelement vertex {len(points)}\n"
    head += "property uchar red\n" + "".join(f"property float {a}\n" for a in "xyz")
    path.write_bytes(head.encode() + b"end_header\n" + rows.tobytes())


def write_ascii_ply(path: Path, points: Points) -> None:
    head = f"ply\nformat ascii 1.0\ncomment x\nelement vertex {len(points)}\n"
    head += "".join(f"property double {a}\n" for a in "zyx") + "element face 0\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    path.write_text(head + "\n".join(f"{z} {y} {x}" for x, y, z in points) + "\n")


def pcd_head(points: Points, kind: str, more: str = "") -> bytes:
    count = len(points)
    return (
        f"# .PCD v0.7\nVERSION 0.7\nFIELDS x _ y z\nSIZE 4 1 4 8\nTYPE F U F F\nCOUNT 1 3 1 1\n"
        f"WIDTH {count}\nHEIGHT 1\n{more}POINTS {count}\nDATA {kind}\n"
    ).encode()


def pcd_rows(points: Points) -> NDArray[np.void]:
    rows = np.zeros(len(points), [("x", "<f4"), ("_", "u1", (3,)), ("y", "<f4"), ("z", "<f8")])
    rows["x"], rows["y"], rows["z"] = points.T
    return rows


def write_pcd(path: Path, points: Points) -> None:
    path.write_bytes(pcd_head(points, "binary") + pcd_rows(points).tobytes())


def write_ascii_pcd(path: Path, points: Points) -> None:
    text = "\n".join(f"{x} 1 2 3 {y} {z}" for x, y, z in points)
    path.write_bytes(pcd_head(points, "ascii") + text.encode())


def packed(data: bytes) -> bytes:
    """What liblzf may make of it: blocks of 32 bytes, those of one byte by a look back."""
    out = b""
    for k in range(0, len(data), 32):
        block = data[k : k + 32]
        if len(block) == 32 and len(set(block)) == 1:
            out += bytes((0, block[0], 7 << 5, 32 - 1 - 2 - 7, 0))
        else:
            out += bytes((len(block) - 1,)) + block
    return out


def write_packed_pcd(path: Path, points: Points) -> None:
    rows = pcd_rows(points)
    plain = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names or ())
    body = packed(plain)
    sizes = struct.pack("<II", len(body), len(plain))
    path.write_bytes(pcd_head(points, "binary_compressed") + sizes + body)


WRITERS: dict[str, tuple[str, Callable[[Path, Points], None]]] = {
    "las": ("las", write_las), "laz": ("laz", write_las), "e57": ("e57", write_e57),
    "text": ("txt", write_text), "xyz": ("XYZ", write_xyz), "ply": ("ply", write_ply),
    "big ply": ("ply", lambda path, points: write_ply(path, points, "big")),
    "ascii ply": ("ply", write_ascii_ply), "pcd": ("pcd", write_pcd),
    "ascii pcd": ("pcd", write_ascii_pcd), "packed pcd": ("pcd", write_packed_pcd),
}  # fmt: skip
