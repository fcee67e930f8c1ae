"""Functions of a plug-in that prints, floods, or ends its process, for `test_seeded.py`."""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from ambinav.runtime.errors import InputError

FLOOD = 40 * 2**20
"""Bytes, many times what a pipe holds."""


def prints(value: Any) -> Any:
    """Print from Python, on both streams, from below it, and from C."""
    print("from python")
    print("to stderr", file=sys.stderr)
    os.write(1, b"from below\n")
    ctypes.CDLL(None).puts(b"from C")
    subprocess.run(["echo", "from a child"], check=True)
    return value


def floods() -> int:
    """Write more than any pipe holds."""
    block = b"x" * 2**20
    for descriptor in (1, 2):
        for _ in range(FLOOD // len(block)):
            os.write(descriptor, block)
    return FLOOD


def dies(signal_number: int) -> None:
    """End this process by a signal, with a child that holds all it was given."""
    subprocess.Popen(["sleep", "100"], close_fds=False)
    os.kill(os.getpid(), signal_number)


def leaves(status: int) -> None:
    """End this process."""
    sys.exit(status)


def asks() -> str:
    """Read what nobody writes."""
    return sys.stdin.read()


def refuses() -> None:
    """Refuse the input."""
    print("no")
    raise InputError("goal: it is inside of a wall.")


def waits(file: str) -> None:
    """Say who it is, and plan for long."""
    Path(file).write_text(str(os.getpid()), encoding="utf-8")
    time.sleep(60.0)


def gives_what_cannot_be_sent() -> Any:
    """Return a function without a name."""
    return lambda: None
