"""Work on a range of rows, shared by a few threads.

The kernels give up the interpreter's lock while they run, so that Python's own threads do: a
kernel with numba's loops would be compiled a second time, for longer than everything else of it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numba
import numpy as np

# So many rows at least are worth waking a thread.
LEAST = 16
# So many pieces for each thread, that one which is held up leaves its rest to the others.
PIECES = 4

_pools: dict[int, ThreadPoolExecutor] = {}
# A forked process has none of its parent's threads.
os.register_at_fork(after_in_child=_pools.clear)


def share(work: Callable[[int, int], None], count: int) -> None:
    """Call `work(low, high)` for pieces that cover rows 0 to `count` - 1, and wait for all.

    Args:
        work: To be done; pieces run at the same time, on as many threads as numba is set to.
        count: How many rows.
    """
    most = count // LEAST
    threads = min(numba.get_num_threads(), most) if most > 1 else 1
    if threads < 2:
        work(0, count)
        return
    if threads not in _pools:
        _pools[threads] = ThreadPoolExecutor(threads - 1, thread_name_prefix="ambinav")
    edges = np.linspace(0, count, min(most, PIECES * threads) + 1).astype(int).tolist()
    pieces = iter(list(pairwise(edges)))

    def some() -> None:
        for low, high in pieces:
            work(low, high)

    others = [_pools[threads].submit(some) for _ in range(threads - 1)]
    some()
    for other in others:
        other.result()
