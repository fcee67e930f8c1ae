"""A process with a line to it, also where a signal comes as it starts."""

from __future__ import annotations

import multiprocessing
import multiprocessing.process
import os
import signal
from multiprocessing.connection import Connection

import pytest

from ambinav.runtime.processes import ChildProcess, begin_worker


def echo(line: Connection, more: int) -> None:
    begin_worker()
    line.send(line.recv() + more)


@pytest.mark.parametrize("method", ["forkserver", "spawn"])
def test_it_answers_and_ends(method: str) -> None:
    others = set(multiprocessing.active_children())
    child = ChildProcess(method, echo, 3)
    child.line.send(4)
    assert child.line.recv() == 7
    for _ in range(2):
        child.kill()
        child.end()
    assert set(multiprocessing.active_children()) <= others


def test_a_signal_as_it_starts_leaves_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    begin = multiprocessing.process.BaseProcess.start

    def start(process: multiprocessing.process.BaseProcess) -> None:
        begin(process)
        os.kill(os.getpid(), signal.SIGINT)

    others = set(multiprocessing.active_children())
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "start", start)
    with pytest.raises(KeyboardInterrupt):
        ChildProcess("spawn", echo, 3)
    assert set(multiprocessing.active_children()) <= others
