"""Rows shared by threads: all of them once, and nobody at work any more after an error."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Iterator

import numba
import numpy as np
import pytest

from ambinav.runtime.threads import SHARE, run_rows, share

LEAST = 16


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("numba has one thread")
    before = numba.get_num_threads()
    numba.set_num_threads(2)
    yield
    numba.set_num_threads(before)


@pytest.mark.parametrize("count", [0, 1, LEAST, 2 * LEAST - 1, 2 * LEAST, 3 * LEAST + 5, 1000])
def test_every_row_is_worked_on_once(count: int) -> None:
    done = np.zeros(count, dtype=int)
    pieces: list[int] = []

    def work(low: int, high: int) -> None:
        done[low:high] += 1
        pieces.append(high - low)

    share(work, count, LEAST)
    assert (done == 1).all()
    assert (len(pieces) == 1) == (count < 2 * LEAST)
    if len(pieces) > 1:
        assert min(pieces) >= LEAST
        assert max(pieces) <= max(count * SHARE / 2, 2 * LEAST)


@pytest.mark.parametrize("here", [True, False])
def test_after_an_error_nobody_is_at_work(here: bool) -> None:
    caller = threading.current_thread()
    begun = ended = 0
    raised = threading.Event()
    both = threading.Barrier(2)

    def work(low: int, high: int) -> None:
        nonlocal begun, ended
        begun += 1
        both.wait(10.0)
        if (threading.current_thread() is caller) == here:
            raised.set()
            raise ValueError(f"rows {low} to {high}")
        raised.wait(10.0)
        time.sleep(0.05)
        ended += 1

    with pytest.raises(ValueError, match="rows"):
        share(work, 20 * LEAST, LEAST)
    assert (begun, ended) == (2, 1)


def test_an_interrupt_that_waited_for_the_threads_to_begin(monkeypatch: pytest.MonkeyPatch) -> None:
    begun, ended, blocks = threading.Event(), threading.Event(), 0

    @contextlib.contextmanager
    def interrupted() -> Iterator[None]:
        nonlocal blocks
        yield
        blocks += 1
        if blocks == 1:
            assert begun.wait(10.0)
            raise KeyboardInterrupt

    def work(low: int, high: int) -> None:
        begun.set()
        time.sleep(0.2)
        ended.set()

    monkeypatch.setattr("ambinav.runtime.threads.holding_interrupts", interrupted)
    with pytest.raises(KeyboardInterrupt):
        share(work, 20 * LEAST, LEAST)
    assert ended.is_set()
    ended.clear()
    time.sleep(0.3)
    assert not ended.is_set()


def test_a_kernel_gets_its_rows_and_its_arguments() -> None:
    out = np.zeros(100)

    def kernel(low: int, high: int, factor: float, out: np.ndarray) -> None:
        out[low:high] = factor * np.arange(low, high)

    run_rows(kernel, 100, 3.0, out)
    np.testing.assert_array_equal(out, 3.0 * np.arange(100))


def test_a_forked_process_has_threads_of_its_own() -> None:
    done = np.zeros(1000, dtype=int)
    share(lambda low, high: done.__setitem__(slice(low, high), 1), len(done))
    child = os.fork()
    if child == 0:
        again = np.zeros(1000, dtype=int)
        share(lambda low, high: again.__setitem__(slice(low, high), 1), len(again))
        os._exit(0 if again.all() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
