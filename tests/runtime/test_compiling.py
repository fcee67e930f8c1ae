"""At a terminal the compiling of kernels is announced, once."""

from __future__ import annotations

import io
from types import FunctionType
from typing import Any

import pytest
from numba import njit
from numba.core import event

from ambinav.runtime import compiling


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def kernel(module: str) -> FunctionType:
    """A function of that module, never compiled before."""

    def twice(x: float) -> float:
        return 2.0 * x

    twice.__module__ = module
    made: FunctionType = njit(twice)
    return made


@pytest.mark.parametrize("terminal", [True, False])
def test_compiling_is_announced_once_and_on_a_terminal_only(
    terminal: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = Terminal() if terminal else io.StringIO()
    monkeypatch.setattr("sys.stderr", shown)
    known: list[tuple[str, event.Listener]] = []
    register = event.register

    def note(*pair: Any) -> None:
        register(*pair)
        # numba listens to itself too.
        if isinstance(pair[1], compiling._Notice):
            known.append(pair)

    monkeypatch.setattr(event, "register", note)
    compiling.announce.__wrapped__()
    kernel("elsewhere")(1.0)
    assert shown.getvalue() == ""
    kernel("ambinav.somewhere")(1.0)
    kernel("ambinav_envs.somewhere")(1.0)
    for pair in known:
        event.unregister(*pair)
    assert shown.getvalue() == (compiling.NOTICE + "\n" if terminal else "")
