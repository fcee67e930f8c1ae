"""Seeded runs: OMPL takes a seed once in the life of a process, so every other run gets its own.

OMPL hands its seeds out in order, one to every sampler that is made, and can neither set nor
reset them later. The first seeded call of a process takes place in it; every further one in a
fresh process that reads it from its standard input. Both give the same result.
"""

from __future__ import annotations

import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

from ambinav.errors import InputError
from ambinav_planners.registry import SEEDS

T = TypeVar("T")


@dataclass
class _Process:
    seed: int | None = None


_process = _Process()


def call_seeded(seed: int | None, function: Callable[..., T], *arguments: Any) -> T:
    """Call a function with OMPL's random numbers seeded.

    Args:
        seed: From 0 on; None for other random numbers every time.
        function: At the top level of a module, so that a fresh process can import it.
        arguments: Its arguments; they and its result are pickled for a fresh process.

    Raises:
        InputError: what the function raised so, here or there.
        RuntimeError: the fresh process failed otherwise; the message holds what it said.
    """
    if seed is None or (_process.seed is None and _take_seed(seed)):
        return function(*arguments)
    task = pickle.dumps((seed, function, arguments))
    command = [sys.executable, "-m", "ambinav_planners.seeded"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as run:
        try:
            answer, stderr = run.communicate(task)
        except BaseException:
            run.kill()
            raise
    if run.returncode != 0:
        raise RuntimeError(f"planning in a fresh process failed: {stderr.decode(errors='replace')}")
    refused, result = pickle.loads(answer)
    if refused is not None:
        raise refused
    value: T = result
    return value


def _take_seed(seed: int) -> bool:
    """Seed OMPL; False if something in this process has drawn from it already."""
    from ompl import util as ou

    _process.seed = seed
    seed = seed or SEEDS
    ou.setLogLevel(ou.LogLevel.LOG_NONE)
    ou.RNG.setSeed(seed)
    ou.setLogLevel(ou.LogLevel.LOG_WARN)
    return bool(ou.RNG.getSeed() == seed)


def _main() -> None:
    """Read a call from standard input and write its result to standard output."""
    seed, function, arguments = pickle.load(sys.stdin.buffer)
    if not _take_seed(seed):
        raise SystemExit("OMPL had drawn random numbers before it could be seeded")
    refused: InputError | None = None
    result = None
    try:
        result = function(*arguments)
    except InputError as error:
        refused = error
    sys.stdout.buffer.write(pickle.dumps((refused, result)))


if __name__ == "__main__":
    _main()
