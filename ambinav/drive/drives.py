"""Recorded drives along one route, one run for each seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ambinav.drive.world import COLLIDED, OUTCOMES, REACHED
from ambinav.geometry.frames import wrap_angles
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints


@dataclass(frozen=True, eq=False)
class Drives:
    """Record of R runs of at most T samples, nan after a run's end (False in `updated`).

    Attributes:
        time: float64, shape (T,), seconds from the start.
        truth: True poses, shape (R, T, 3): x, y in metres, heading in radians, map frame.
        odometry: Odometry poses, shape (R, T, 3); it starts at 0, 0, 0 in its own frame.
        estimate: Estimated poses, shape (R, T, 3), map frame.
        covariance: Covariances of the estimates, shape (R, T, 3, 3); zero if they are the true
            poses.
        updated: True if the localizer used the readings, bool, shape (R, T).
        samples: Number of samples of each run, int64, shape (R,).
        outcome: Code of the outcome, int64, shape (R,), see `OUTCOMES`.
        goal: x, y, heading of the route's end.
        length: Length of the route, metres.
        open_loop: True if the true pose was kept on the route.
        ranges: float32, shape (R, T, B), the readings; None if they were not kept.
    """

    time: Floats
    truth: Floats
    odometry: Floats
    estimate: Floats
    covariance: Floats
    updated: Bools
    samples: Ints
    outcome: Ints
    goal: tuple[float, float, float]
    length: float
    open_loop: bool
    ranges: Floats32 | None

    def __len__(self) -> int:
        """Return the number of runs R."""
        return len(self.truth)

    @property
    def reached(self) -> Bools:
        """Mask of runs that ended with the estimate at the goal, shape (R,)."""
        return np.asarray(self.outcome == REACHED)

    @property
    def collided(self) -> Bools:
        """Mask of runs that ended at a wall, shape (R,)."""
        return np.asarray(self.outcome == COLLIDED)

    @property
    def seconds(self) -> Floats:
        """Duration of each run, seconds, shape (R,)."""
        return self.time[self.samples - 1]

    def errors(self) -> Floats:
        """Return estimate minus truth, (R, T, 3): metres, and radians within half a turn of 0."""
        out = self.estimate - self.truth
        out[..., 2] = wrap_angles(out[..., 2])
        return out

    def travelled(self) -> Floats:
        """Return the true metres driven up to each sample, shape (R, T)."""
        steps = np.diff(self.truth[..., :2], axis=1, prepend=self.truth[:, :1, :2])
        return np.asarray(np.cumsum(np.hypot(steps[..., 0], steps[..., 1]), axis=1))

    def __repr__(self) -> str:
        """Return the number of runs and their outcomes as text."""
        counts = np.bincount(self.outcome, minlength=len(OUTCOMES))
        ends = ", ".join(f"{n} {name}" for n, name in zip(counts, OUTCOMES, strict=True) if n)
        return f"<Drives: {len(self)} runs of {self.length:.1f} m: {ends}>"


class Recorder:
    """Recorder of the samples of R runs.

    Args:
        runs: R.
        steps: How many samples a run has at most.
        beams: B, to keep the readings; None to leave them.
    """

    def __init__(self, runs: int, steps: int, beams: int | None) -> None:
        self._poses = np.full((3, runs, steps, 3), np.nan)
        self._covariance = np.full((runs, steps, 3, 3), np.nan)
        self._updated = np.zeros((runs, steps), dtype=np.bool_)
        self._samples = np.zeros(runs, dtype=np.int64)
        self._ranges = None
        if beams is not None:
            self._ranges = np.full((runs, steps, beams), np.nan, dtype=np.float32)
        self._count = 0

    def add(
        self,
        going: Bools,
        poses: tuple[Floats, Floats, Floats],
        covariance: Floats,
        fresh: Bools,
        ranges: Floats32,
    ) -> None:
        """Add a sample of the runs that still drive, bool, shape (R,).

        Args:
            going: Which.
            poses: Truth, odometry and estimate, each of shape (R, 3).
            covariance: Shape (R, 3, 3).
            fresh: Whether the localizer took the readings in, shape (R,).
            ranges: Shape (R, B); not looked at if the readings are not kept.
        """
        k = self._count
        for kind, rows in enumerate(poses):
            self._poses[kind, going, k] = rows[going]
        self._covariance[going, k] = covariance[going]
        self._updated[going, k] = fresh[going]
        if self._ranges is not None:
            self._ranges[going, k] = ranges[going]
        self._samples += going
        self._count = k + 1

    def drives(
        self,
        dt: float,
        outcome: Ints,
        goal: tuple[float, float, float],
        length: float,
        open_loop: bool,
    ) -> Drives:
        """Return everything added; `dt` is the time between two samples, seconds."""
        recorded = slice(0, self._count)
        truth, odometry, estimate = (poses[:, recorded].copy() for poses in self._poses)
        return Drives(
            dt * np.arange(self._count, dtype=np.float64),
            truth,
            odometry,
            estimate,
            self._covariance[:, recorded].copy(),
            self._updated[:, recorded].copy(),
            self._samples,
            outcome,
            goal,
            length,
            open_loop,
            None if self._ranges is None else self._ranges[:, recorded].copy(),
        )
