"""Claim that allows one build at a time at a URL, where the system has no locks.

Who builds leaves an object beside the map that says when it was last alive. It saves tiles from
being made twice and nothing depends on it: two that build the same map write the same bytes.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import threading
import time
import uuid
from collections.abc import Iterator
from typing import Any, Final

from ambinav.runtime.errors import InputError

SUFFIX: Final = ".build"
"""Suffix of the claim, which lies beside the map, as zarr warns of unknown objects within it."""
BEAT: Final = 10.0
"""Seconds between two signs of life."""
DEAD: Final = 45.0
"""Seconds after which whoever gave none counts as gone."""


@contextlib.contextmanager
def claimed(system: Any, root: str, place: str) -> Iterator[None]:
    """Hold the claim of a place while the block runs.

    Args:
        system: Its file system, of fsspec.
        root: Where it lies in that.
        place: What messages call it.

    Raises:
        InputError: another build holds it.
    """
    path, build_id = f"{root}{SUFFIX}", uuid.uuid4().hex
    _refuse_other(_read(system, path), build_id, place)
    ended = threading.Event()

    def beat() -> None:
        record = {"id": build_id, "host": platform.node(), "pid": os.getpid(), "time": time.time()}
        system.pipe_file(path, json.dumps(record).encode())

    def keep_beating() -> None:
        while not ended.wait(BEAT):
            with contextlib.suppress(Exception):  # the tiles themselves tell what is wrong
                beat()

    try:
        beat()
    # Whatever a file system raises: each has errors of its own.
    except Exception as error:
        raise InputError(
            f"{place}: nothing can be written beside it ({error}); name a folder in a bucket into "
            "which you may write."
        ) from error
    _refuse_other(_read(system, path), build_id, place)  # a build that began at the same moment
    beating = threading.Thread(target=keep_beating, daemon=True)
    beating.start()
    try:
        yield
    finally:
        ended.set()
        beating.join(BEAT)
        with contextlib.suppress(Exception):
            system.rm_file(path)


def _read(system: Any, path: str) -> dict[str, Any] | None:
    """Return the contents of the object; None if there is none or it cannot be read."""
    system.invalidate_cache()
    try:
        claim = json.loads(system.cat_file(path))
        return {"id": str(claim["id"]), "host": str(claim["host"]), "time": float(claim["time"])}
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _refuse_other(claim: dict[str, Any] | None, build_id: str, place: str) -> None:
    if claim is None or claim["id"] == build_id:
        return
    ago = abs(time.time() - claim["time"])
    if ago < DEAD:
        raise InputError(
            f"{place}: another build, on {claim['host']}, was at work here {ago:.0f} s ago; wait "
            "for it, or choose another output."
        )
