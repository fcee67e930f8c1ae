"""Processes that work for this one begin undisturbed."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

from ambinav.runtime.processes import putting_signals_off


@pytest.mark.parametrize(
    ("number", "raises"), [(signal.SIGINT, KeyboardInterrupt), (signal.SIGTERM, SystemExit)]
)
def test_a_signal_waits_until_the_processes_have_begun(
    number: signal.Signals, raises: type[BaseException]
) -> None:
    """Another thread takes it, as the one that reads the building: this one raises later."""
    begin, sent = threading.Event(), threading.Event()

    def send() -> None:
        assert begin.wait(60)
        # To this thread: whichever thread takes one sent to the process may do so only later.
        signal.pthread_kill(threading.get_ident(), number)
        sent.set()

    def handler(number: int, frame: object) -> None:
        raise raises

    before = signal.signal(number, handler)
    sender = threading.Thread(target=send)
    sender.start()
    begun = False
    try:
        with pytest.raises(raises), putting_signals_off():
            begin.set()
            assert sent.wait(60)
            begun = True
        assert begun
        assert signal.getsignal(number) is handler
    finally:
        signal.signal(number, before)
        sender.join()
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, set()) & {signal.SIGINT}


def test_elsewhere_than_in_the_main_thread_nothing_raises() -> None:
    """Signals are heard in the main thread alone; the handlers stay."""
    before, ended = signal.getsignal(signal.SIGINT), []

    def begin() -> None:
        with putting_signals_off():
            ended.append(signal.getsignal(signal.SIGINT) is before)

    thread = threading.Thread(target=begin)
    thread.start()
    thread.join()
    assert ended == [True]


def test_a_signal_that_another_thread_takes_leaves_none_blocked() -> None:
    """Of 3000, two came before the mask was as it had been."""
    stop = threading.Event()
    other = threading.Thread(target=stop.wait)
    other.start()
    try:
        for _ in range(1000):
            with pytest.raises(KeyboardInterrupt):
                with putting_signals_off():
                    os.kill(os.getpid(), signal.SIGINT)
                time.sleep(1.0)  # it may come a moment later
            assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, set())
    finally:
        stop.set()
        other.join()
