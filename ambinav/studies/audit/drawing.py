"""A process that draws an audit's pictures while the main process searches for advice.

Matplotlib takes long to import, and holds the interpreter's lock most of the time.
"""

from __future__ import annotations

import gc
import pickle
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ambinav.maps import schema
from ambinav.runtime.errors import InputError
from ambinav.runtime.processes import ChildProcess, begin_worker
from ambinav.runtime.progress import Progress, silent

if TYPE_CHECKING:
    from ambinav.studies.audit.audit import Audit

NOT_DRAWN: Final = ("ambiguity", "major_radius", "minor_radius")
"""Layers that no picture shows; with their means they take 40 % of a map with headings."""
Draw = Callable[["Audit", Path, Progress, str], None]
"""Draws as `ambinav.studies.audit.pictures.save_pictures` does."""


@contextmanager
def drawing() -> Iterator[Draw]:
    """Start a drawing process and yield it; it ends with the block.

    It is a fork, which has all modules from the start. Threads do not survive one: where some have
    begun, or the system has no forks that are safe, this process draws.
    """
    if sys.platform != "linux" or threading.active_count() > 1:
        from ambinav.studies.audit.pictures import save_pictures

        yield save_pictures
        return
    process = DrawingProcess()
    try:
        yield process.draw
    finally:
        process.end()


class DrawingProcess(ChildProcess):
    """A process that draws the pictures of audits."""

    def __init__(self) -> None:
        # Existing objects are frozen, so that neither process scans them for garbage again.
        gc.freeze()
        with warnings.catch_warnings():
            # Python from 3.12 on warns about OpenBLAS's threads, which handle forks themselves.
            warnings.simplefilter("ignore", DeprecationWarning)
            super().__init__("fork", _serve)

    def draw(
        self, audit: Audit, folder: Path, progress: Progress = silent, image_format: str = "png"
    ) -> None:
        """Draw all pictures into `folder`.

        Args:
            audit: The audit to draw.
            folder: Output folder.
            progress: Called with the fraction done.
            image_format: One of `ambinav.plotting.style.FORMATS`.

        Raises:
            InputError, OSError: a picture cannot be written.
            RuntimeError: it failed otherwise, or was killed.
        """
        # Only the floor of a three-dimensional building is drawn; its many triangles are dropped.
        amap = copy(audit.amap)
        names = (str(name) for name in amap.dataset.variables)
        amap.dataset = amap.dataset.drop_vars(
            [name for name in names if schema.base_name(name) in NOT_DRAWN]
        )
        drawn = replace(audit, amap=amap, environment=amap.environment)
        try:
            _send(self.line, (drawn, folder, image_format))
            while isinstance(answer := self.line.recv(), float):
                progress(answer)
        except (EOFError, BrokenPipeError, ConnectionResetError):
            raise RuntimeError(
                "the process that draws the pictures was killed, perhaps for lack of memory"
            ) from None
        if answer is not None:
            raise answer


def _serve(line: Connection) -> None:
    """Draw what is requested over the connection until it closes."""
    begin_worker()
    from ambinav.studies.audit.pictures import save_pictures

    while True:
        try:
            audit, folder, image_format = _received(line)
        except (EOFError, ConnectionResetError):
            return
        failure: Exception | None = None
        try:
            save_pictures(audit, folder, line.send, image_format)
        except (InputError, OSError) as error:
            failure = error
        except Exception:
            failure = RuntimeError(f"the pictures cannot be drawn\n{traceback.format_exc()}")
        line.send(failure)


def _send(line: Connection, value: object) -> None:
    """Send a value, its arrays straight from where they are: a pickle would hold them again."""
    arrays: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(value, 5, buffer_callback=arrays.append)
    parts = [array.raw() for array in arrays]
    line.send((pickled, [part.nbytes for part in parts]))
    for part in parts:
        line.send_bytes(part)


def _received(line: Connection) -> Any:
    """Receive what `_send` sends."""
    pickled, sizes = line.recv()
    # Bytes would make arrays that cannot be written, for which kernels are compiled anew.
    parts = [bytearray(size) for size in sizes]
    for part in parts:
        line.recv_bytes_into(part)
    return pickle.loads(pickled, buffers=parts)
