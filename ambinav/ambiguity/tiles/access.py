"""Whether tiles can be written to a URL, found out before anything is computed."""

from __future__ import annotations

import queue
import threading
from typing import Final

from ambinav.ambiguity.tiles.store import TileStore, reason_of
from ambinav.errors import InputError

PATIENCE: Final = 6.0
"""Seconds in which what is at the URL must answer: clients of buckets try for minutes."""
BUCKETS: Final = frozenset({"s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl"})
"""Protocols without folders: to make one would make the bucket, of a name misspelt perhaps."""


def check_access(store: TileStore) -> None:
    """Write a probe to a URL, and remove it.

    Raises:
        InputError: that is not possible, for want of rights say, or nobody answers.
    """
    answer: queue.SimpleQueue[Exception | None] = queue.SimpleQueue()

    def probe() -> None:
        try:
            system, root = store.files
            if store.place.partition("://")[0] not in BUCKETS:
                system.makedirs(root, exist_ok=True)
            system.pipe_file(f"{root}/.ambinav-probe", b"probe")
            system.rm_file(f"{root}/.ambinav-probe")
        # Whatever a file system raises: each has errors of its own.
        except Exception as error:
            answer.put(error)
        else:
            answer.put(None)

    threading.Thread(target=probe, daemon=True).start()
    try:
        error = answer.get(timeout=PATIENCE)
    except queue.Empty:
        raise InputError(
            f"{store.place}: nobody answers there within {PATIENCE:g} s; check the address (of a "
            "server of your own AWS_ENDPOINT_URL) and the network, or choose another output."
        ) from None
    if error is not None:
        raise InputError(
            f"{store.place}: nothing can be written there ({reason_of(error)}); check the "
            "address and your rights, or choose another output."
        ) from error
