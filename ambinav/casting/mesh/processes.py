"""Processes that cast rays with Embree, which holds Python's interpreter lock while it works."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import threading
import weakref
from contextlib import suppress
from mmap import mmap
from pathlib import Path

import numpy as np

from ambinav.casting.mesh import embree
from ambinav.casting.mesh.embree import RAY_BYTES, RayBlock, cast_piece, scene_of
from ambinav.runtime.array_types import Floats32, Ints32
from ambinav.runtime.files import holding_interrupts

# Rays per block: 16 MB of shared memory.
BLOCK = 500_000
# Minimum number of rays for each process.
LEAST = 4096
# Seconds after which a process that should end is killed.
PATIENCE = 5.0
MEMORY = Path("/dev/shm")


class EmbreeCaster:
    """Caster of ray blocks against triangles, in this process or in several others.

    The others are started with the first block, and end with `close`, when this object is no
    longer used, or when this process ends, however it does. A ray's result depends neither on
    their number nor on which rays are cast beside it.

    Args:
        vertices: float32, shape (V, 3), metres.
        faces: int32, shape (F, 3).
        processes: How many; 1: this one.
    """

    def __init__(self, vertices: Floats32, faces: Ints32, processes: int) -> None:
        self._mesh = vertices, faces
        self._count = processes
        self._lock = threading.Lock()
        self._team: _Team | None = None
        self._scene = scene_of(vertices, faces) if processes == 1 else None

    def cast(self, origin: Floats32, direction: Floats32, reach: float) -> tuple[Floats32, Ints32]:
        """Return distance, (N,), inf for none, and face, -1 for none, of rays, (N, 3).

        Raises:
            RuntimeError: one of the processes has ended.
        """
        count = len(origin)
        distance = np.empty(count, dtype=np.float32)
        face = np.empty(count, dtype=np.int32)
        if self._scene is not None:
            rays = RayBlock(origin, direction, distance, face)
            for low in range(0, count, BLOCK):
                cast_piece(self._scene, rays, low, min(low + BLOCK, count), reach)
            return distance, face
        with self._lock:
            try:
                if self._team is None:
                    self._team = _Team(*self._mesh, self._count)
                for low in range(0, count, BLOCK):
                    part = slice(low, low + BLOCK)
                    hits = self._team.cast(origin[part], direction[part], reach)
                    distance[part], face[part] = hits
            except BaseException:
                # Late answers may still arrive, and must not be taken for those of the next block.
                self.close()
                raise
        return distance, face

    def close(self) -> None:
        """End the processes; the next block starts new ones."""
        team, self._team = self._team, None
        if team is not None:
            team.close()


class _Team:
    """Processes, and the memory that they share with this one."""

    def __init__(self, vertices: Floats32, faces: Ints32, processes: int) -> None:
        # Files without a name, so that none is left behind; in memory where there is such a folder.
        where = MEMORY if MEMORY.is_dir() else None
        with tempfile.TemporaryFile(dir=where) as mesh, tempfile.TemporaryFile(dir=where) as block:
            mesh.write(vertices.tobytes() + faces.tobytes())
            mesh.flush()
            block.truncate(BLOCK * RAY_BYTES)
            self._memory = mmap(block.fileno(), BLOCK * RAY_BYTES)
            files = mesh.fileno(), block.fileno()
            words = files[0], len(vertices), len(faces), files[1], BLOCK
            # -P: the folder of the program is no place to import from. A group of its own: Ctrl-C
            # is for the one who waits for it.
            command = [sys.executable, "-P", str(embree.__file__), *map(str, words)]
            self._processes: list[subprocess.Popen[bytes]] = []
            self.close = weakref.finalize(self, _stop, self._processes)
            with holding_interrupts():
                for _ in range(processes):
                    self._processes.append(
                        subprocess.Popen(
                            command,
                            stdin=subprocess.PIPE,
                            stdout=subprocess.PIPE,
                            pass_fds=files,
                            process_group=0,
                        )
                    )
        self._rays = RayBlock.of(self._memory, BLOCK)

    def cast(self, origin: Floats32, direction: Floats32, reach: float) -> tuple[Floats32, Ints32]:
        """Cast at most `BLOCK` rays, as `EmbreeCaster.cast` does.

        The next call overwrites the returned arrays.
        """
        count = len(origin)
        self._rays.origin[:count], self._rays.direction[:count] = origin, direction
        shares = max(min(len(self._processes), count // LEAST), 1)
        edges = [count * i // shares for i in range(shares + 1)]
        busy = self._processes[:shares]
        for process, low, high in zip(busy, edges[:-1], edges[1:], strict=True):
            assert process.stdin is not None
            try:
                process.stdin.write(f"{low} {high} {reach!r}\n".encode())
                process.stdin.flush()
            except BrokenPipeError:
                raise _process_error(process) from None
        for process in busy:
            assert process.stdout is not None
            if not process.stdout.readline():
                raise _process_error(process)
        return self._rays.distance[:count], self._rays.face[:count]


def _process_error(process: subprocess.Popen[bytes]) -> RuntimeError:
    """Return the error to raise when a process has ended."""
    try:
        status = str(process.wait(PATIENCE))
    except subprocess.TimeoutExpired:
        status = "unknown"
    return RuntimeError(f"a process that casts rays has ended with the status {status}")


def _stop(processes: list[subprocess.Popen[bytes]]) -> None:
    """End processes by closing their input."""
    for process in processes:
        for pipe in (process.stdin, process.stdout):
            assert pipe is not None
            with suppress(BrokenPipeError):
                pipe.close()
    for process in processes:
        try:
            process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
