"""Drives of a comparison in the test's own process."""

from __future__ import annotations

import multiprocessing
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from ambinav.runtime.errors import InputWarning


@contextmanager
def inline_drives() -> Iterator[None]:
    """Start no process for one job: it would import for two seconds what is imported here.

    Several are copies of one that has imported it.
    """
    from ambinav.studies.compare import exports, runs, workers

    in_workers = workers.in_workers

    def inline(
        setup: workers.Setup, function: Callable[..., Any], pieces: Sequence[Any], jobs: int
    ) -> Iterator[tuple[Any, Any]]:
        if jobs > 1:
            forks = SimpleNamespace(get_context=lambda _: multiprocessing.get_context("forkserver"))
            with pytest.MonkeyPatch.context() as several:
                several.setattr(workers, "multiprocessing", forks)
                yield from in_workers(setup, function, pieces, jobs)
            return
        for piece in pieces:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", InputWarning)  # as in worker processes
                made = function(setup, piece)
            yield piece, made

    with pytest.MonkeyPatch.context() as patch:
        for module in (exports, runs):
            patch.setattr(module, "in_workers", inline)
        yield
