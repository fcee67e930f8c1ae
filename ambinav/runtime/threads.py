"""Work on a range of rows, shared by several threads.

Kernels give up the interpreter's lock while they run, so Python's own threads do. A kernel with
numba's parallel loops takes twice to four times as long to compile, cannot share its machine code
with a call on one thread, and ends a process that was forked from one that has run it.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from itertools import pairwise
from typing import Any

import numba

from ambinav.runtime.files import holding_interrupts

# A piece is this share of what is left, over the number of threads: the first ones are long, since
# each costs a few microseconds, the last ones short, so that nobody waits long for a thread that
# was held up (Polychronopoulos & Kuck 1987, "Guided self-scheduling").
SHARE = 0.5

_pools: dict[int, ThreadPoolExecutor] = {}
# A forked process has none of its parent's threads.
os.register_at_fork(after_in_child=_pools.clear)


def share(work: Callable[[int, int], object], count: int, least: int = 1) -> None:
    """Call `work(low, high)` for pieces that cover rows 0 to `count` - 1, and wait for all.

    Args:
        work: To be done; pieces run at the same time, on as many threads as numba is set to. What
            it raises is raised here, and no other piece is begun. It must not call this itself:
            it would wait for the thread that it runs on.
        count: How many rows.
        least: Rows of a piece: fewer are not worth waking a thread.
    """
    most = count // least
    threads = min(numba.get_num_threads(), most) if most > 1 else 1
    if threads < 2:
        work(0, count)
        return
    pieces = iter(list(pairwise(_edges(count, threads, least))))

    def run_pieces() -> None:
        try:
            for low, high in pieces:
                work(low, high)
        except BaseException:
            for _ in pieces:
                pass
            raise

    others: list[Future[None]] = []
    try:
        # Ctrl-C within them would leave the executor's locks taken, and whoever comes next, were it
        # only Python's own end, would wait for them for ever. It comes out of the block's end.
        with holding_interrupts():
            if threads not in _pools:
                _pools[threads] = ThreadPoolExecutor(threads - 1, thread_name_prefix="ambinav")
            for _ in range(threads - 1):
                others.append(_pools[threads].submit(run_pieces))
        run_pieces()
    except BaseException:
        for _ in pieces:
            pass
        raise
    finally:
        # After an error no thread may still be running when the caller continues.
        with holding_interrupts():
            wait(others)
    for other in others:
        other.result()


def _edges(count: int, threads: int, least: int) -> list[int]:
    """Return where pieces begin, and where the last one ends."""
    edges = [0]
    while (left := count - edges[-1]) >= 2 * least:
        edges.append(edges[-1] + max(int(left * SHARE / threads), least))
    return [*edges, count]


def run_rows(kernel: Callable[..., object], count: int, *arguments: Any, least: int = 1) -> None:
    """Run a kernel over rows 0 to `count` - 1, shared by threads.

    Args:
        kernel: Compiled with `nogil=True`; takes the first row and the one past the last, then the
            arguments, and writes nothing but these rows of its results.
        count: How many rows.
        arguments: Its others.
        least: See `share`.
    """
    share(lambda low, high: kernel(low, high, *arguments), count, least)
