"""A process for tests that works at an edit until it is stopped."""

from __future__ import annotations

from multiprocessing.connection import Connection


def until_stopped(line: Connection) -> None:
    """Answer each task when None comes."""
    while True:
        while line.recv() is not None:
            pass
        line.send(None)
