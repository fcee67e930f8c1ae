"""Point clouds: time and memory of reading 10 million points of a hall of 60 x 40 x 3 m.

Each format is written, and read in a process of its own. "Counting" is reading the points and
counting them in voxels of 5 cm; "all" is `read_cloud`, which makes a mesh of the voxels. Memory is
the most that the process held, less what it held with everything imported.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from harness import arguments, option, report, table
from numpy.typing import NDArray

from ambinav.buildings.mesh import cloud

SIZE = np.array((60.0, 40.0, 3.0))
NOISE, VOXEL = 0.005, 0.05
FORMATS = ("las", "laz", "e57")


def hall(count: int) -> NDArray[np.float64]:
    """Return points on the six sides, with noise, in random order, shape (about `count`, 3)."""
    rng = np.random.default_rng(0)
    area = np.repeat(np.prod(SIZE) / SIZE, 2)
    parts = []
    for side, share in enumerate(area / area.sum()):
        side_points = rng.random((int(count * share), 3)) * SIZE
        side_points[:, side // 2] = SIZE[side // 2] * (side % 2)
        parts.append(side_points)
    points = np.concatenate(parts)
    points += rng.normal(0.0, NOISE, points.shape)
    rng.shuffle(points)
    return points


def write(path: Path, points: NDArray[np.float64]) -> None:
    """Write the points in the format of the suffix."""
    if path.suffix == ".e57":
        import pye57

        with pye57.E57(str(path), mode="w") as file:
            file.write_scan_raw({f"cartesian{a}": points[:, k].copy() for k, a in enumerate("XYZ")})
    else:
        import laspy

        header = laspy.LasHeader(point_format=3, version="1.2")
        header.scales = np.full(3, 0.001)
        data = laspy.LasData(header)
        data.x, data.y, data.z = points.T
        data.write(str(path))


def held() -> float:
    """Return the peak memory of this process, GB."""
    # Of ru_maxrss a child inherits what its parent had.
    lines = Path("/proc/self/status").read_text().splitlines()
    (peak,) = (line.split()[1] for line in lines if line.startswith("VmHWM"))
    return int(peak) / 1e6


def read(path: Path) -> str:
    """Return seconds and gigabytes of counting and in total, voxels and triangles."""
    before, start = held(), time.perf_counter()
    counter = cloud._VoxelCounter(path, 1.0 / VOXEL, VOXEL)
    for chunk in cloud._chunks(path, [], None):
        counter.add(chunk)
    counting, held_then = time.perf_counter() - start, held() - before
    start = time.perf_counter()
    mesh = cloud.read_cloud(path, voxel=VOXEL)
    every = time.perf_counter() - start
    return (
        f"{counting:.1f},{held_then:.2f},{every:.1f},{held() - before:.2f},"
        f"{len(counter.code) / 1e6:.2f},{len(mesh.faces) / 1e6:.1f}"
    )


def main() -> None:
    """Measure as the command line says, and report."""
    args = arguments(__doc__, points=10000000, read=option(None, "read this file alone", type=Path))
    if args.read is not None:
        print(read(args.read))
        return
    rows: list[tuple[object, ...]] = []
    points = hall(args.points)
    with tempfile.TemporaryDirectory() as folder:
        for suffix in FORMATS:
            path = Path(folder) / f"hall.{suffix}"
            write(path, points)
            command = [sys.executable, __file__, "--read", str(path)]
            result = subprocess.run(command, capture_output=True, text=True, check=True)
            size = f"{path.stat().st_size / 1e6:.0f} MB"
            rows.append((f".{suffix}", size, *result.stdout.split()[-1].split(",")))
            path.unlink()
    head = ("file", "size", "counting, s", "GB", "all, s", "GB", "million voxels", "triangles")
    body = f"{len(points)} points.\n\n{table(head, rows)}"
    report("Point clouds", ("numpy", "laspy", "lazrs", "pye57"), body, args.out)


if __name__ == "__main__":
    main()
