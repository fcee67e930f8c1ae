"""Reports of how far long work is."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[float], None]
"""Takes the share of the work that is done, 0 to 1."""
Stages = Callable[[str], Progress]
"""Begins a stage of the work, named by a text, and returns the progress of that stage."""


def silent(share: float) -> None:
    """Report no progress."""


def silent_stages(text: str) -> Progress:
    """Begin a stage whose progress is not reported."""
    return silent


def within(progress: Progress, low: float, high: float) -> Progress:
    """Return the progress of a part of the work, which leads from one share to another."""
    return lambda share: progress(low + (high - low) * share)


def step_of(progress: Progress, done: int, count: int) -> Progress:
    """Return the progress of the step after `done` of `count` equal ones."""
    return lambda share: progress((done + share) / count)
