"""Imports what worker processes run: what `multiprocessing` loads before it makes copies."""

import contextlib

from numba.core.registry import cpu_target

import ambinav.server.jobs.workers
import ambinav.studies.compare.workers
import ambinav.studies.fleet.fleet
import ambinav.tiles.build  # noqa: F401

with contextlib.suppress(ImportError):
    import distributed  # noqa: F401

# The half of a second in which numba gets ready for its first kernel.
cpu_target.typing_context.refresh()
cpu_target.target_context.refresh()
