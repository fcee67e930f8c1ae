"""Two that want one map: one builds and the other waits, and nobody waits for ever."""

from __future__ import annotations

import os
import signal
import threading
import time

import pytest

import ambinav as an
from ambinav.store import build_lock
from ambinav.store.map_store import MapStore
from tests.maps import synthetic
from tests.store.scenes import names, python, same


def test_two_threads_build_one_map_once(store) -> None:
    inside, go_on, notified = threading.Event(), threading.Event(), threading.Event()
    found: dict[str, tuple[an.AmbiguityMap, bool]] = {}

    def slow(alive):
        inside.set()
        assert go_on.wait(60)
        return an.AmbiguityMap(synthetic.dataset())

    def take(name, place, make):
        found[name] = place.opened_or_built("a" * 32, make)

    waiting = MapStore(store.folder, notify=lambda text: notified.set())
    first = threading.Thread(target=take, args=("first", store, slow))
    second = threading.Thread(target=take, args=("second", waiting, pytest.fail))
    first.start()
    assert inside.wait(60)
    second.start()
    assert notified.wait(60) and second.is_alive()  # "waiting for it"
    go_on.set()
    for one in (first, second):
        one.join(60)
    assert (found["first"][1], found["second"][1]) == (False, True)
    assert same(found["first"][0], found["second"][0])
    assert names(store) == ["a" * 32 + ".map"]


def test_a_map_of_another_key_waits_for_nobody(store) -> None:
    def outer(alive):
        return store.opened_or_built("b" * 32, inner)[0]

    def inner(alive):
        return an.AmbiguityMap(synthetic.dataset())

    assert not store.opened_or_built("a" * 32, outer)[1]
    assert len(names(store)) == 2


HOLDER = """
import sys, time
from pathlib import Path
from ambinav.store.build_lock import build_lock
with build_lock(Path(sys.argv[1]), 60.0, lambda: None) as alive:
    assert alive is not None
    print("held", flush=True)
    time.sleep(300)
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_holder_that_is_killed_or_stopped_holds_up_nobody(store, number) -> None:
    """The lock of a killed one is gone at once; one that stands still is waited for in vain."""
    store.place.mkdir()
    lock = store.place / f"{'a' * 32}.lock"
    process = python(HOLDER, str(lock))
    try:
        assert process.stdout.readline() == "held\n"
        impatient = MapStore(store.folder, patience=0.3)
        os.kill(process.pid, number)
        if number == signal.SIGKILL:
            process.wait(60)
        start = time.monotonic()
        amap, opened = impatient.opened_or_built(
            "a" * 32, lambda alive: an.AmbiguityMap(synthetic.dataset())
        )
        assert not opened and time.monotonic() - start < 30.0
        assert lock.exists() == (number == signal.SIGSTOP)
    finally:
        process.kill()
        process.communicate(timeout=60)
    assert store.opened_or_built("a" * 32, pytest.fail)[0].dataset.identical(amap.dataset)


@pytest.mark.slow
def test_a_holder_at_work_is_not_given_up(tmp_path) -> None:
    lock = tmp_path / "a.lock"
    over, waits = threading.Event(), threading.Event()
    with build_lock.build_lock(lock, 60.0, pytest.fail) as alive:
        assert alive is not None

        def wait_for_it() -> None:
            with build_lock.build_lock(lock, 1.0, waits.set) as own:
                assert own is not None and over.is_set()
                waits.clear()

        waiter = threading.Thread(target=wait_for_it)
        waiter.start()
        assert waits.wait(60)
        end = time.monotonic() + 1.5
        while time.monotonic() < end:
            alive()
            time.sleep(0.02)
        over.set()
    waiter.join(60)
    assert not waits.is_set() and not lock.exists()


def test_a_lock_that_cannot_be_touched_stops_nothing(tmp_path, monkeypatch) -> None:
    """As on a network drive where another removed the file."""

    def stale(*arguments):
        raise OSError(116, "Stale file handle")

    with build_lock.build_lock(tmp_path / "a.lock", 60.0, pytest.fail) as alive:
        assert alive is not None
        monkeypatch.setattr(os, "utime", stale)
        alive()


def test_one_lock_has_one_holder(tmp_path) -> None:
    """Though its file comes and goes all the time."""
    lock, inside, most = tmp_path / "a.lock", [0], [0]

    def work() -> None:
        for _ in range(100):
            with build_lock.build_lock(lock, 60.0, lambda: None) as alive:
                assert alive is not None
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                time.sleep(0)
                inside[0] -= 1

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build_lock, "POLL", 0.0001)
        threads = [threading.Thread(target=work) for _ in range(4)]
        for one in threads:
            one.start()
        for one in threads:
            one.join(60)
    assert most == [1] and not lock.exists()


def test_without_locks_both_build(store, monkeypatch) -> None:
    import fcntl

    def none(*arguments):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(fcntl, "flock", none)
    make = lambda alive: an.AmbiguityMap(synthetic.dataset())  # noqa: E731
    assert not store.opened_or_built("a" * 32, make)[1]
    assert store.opened_or_built("a" * 32, make)[1]
