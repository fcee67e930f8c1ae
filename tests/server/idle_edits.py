"""Processes for tests that work at an edit until it is stopped."""

from __future__ import annotations

import os
import pickle
import struct
from multiprocessing.connection import Connection
from pathlib import Path


def until_stopped(line: Connection) -> None:
    """Answer each task when None comes."""
    while True:
        while line.recv() is not None:
            pass
        line.send(None)


def in_two_parts(line: Connection) -> None:
    """Answer each task, a file to touch between both, in two parts; the second when None comes."""
    while True:
        begun: Path = line.recv()
        answer = pickle.dumps(os.getpid())
        whole = struct.pack("!i", len(answer)) + answer
        os.write(line.fileno(), whole[:6])
        begun.touch()
        line.recv()
        os.write(line.fileno(), whole[6:])
