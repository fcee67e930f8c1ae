"""Metrics of a drive: figures of each run, and of a route over its runs."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from types import NoneType

import numpy as np

from ambinav.config import check_kind
from ambinav.drive.drives import Drives
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Bools, Floats
from ambinav.service.field import Field

LOST_POSITION, LOST_HEADING, LOST_SECONDS = 0.5, math.radians(30.0), 1.0
"""A robot is lost whose true error is above one of the first two for longer than the third."""

ARRIVAL = 0.5
"""A robot has arrived that stops within this distance of the goal, metres."""

# Rounding of times, seconds.
INSTANT = 1e-9
# A covariance has full rank whose least eigenvalue is above this share of the greatest.
FULL_RANK = 1e-12
LEAST_STD = 5e-4
"""Metres or radians; a lower deviation, as of a few particles that are left, counts as this."""


@dataclass(frozen=True, eq=False)
class Metrics:
    """Figures of R runs, each an array of shape (R,).

    Errors are those of the estimate relative to the true pose, over the samples of a run, which are
    evenly spaced in time. The weak direction is the map's `direction` at the true pose, along which
    a scan gives the least information.

    Attributes:
        arrived: True if the estimate was at the goal and the robot was truly near it.
        collided: True if it touched a wall.
        lost: True if it was ever lost.
        lost_after: Seconds from the start until it was first lost; nan if it never was.
        lost_share: Share of its time with an error so large.
        position_rmse: Metres.
        position_p95: 95th percentile, metres.
        position_max: Metres.
        heading_rmse: Radians.
        heading_p95: Radians.
        heading_max: Radians.
        weak_rmse: RMS of the position's error along the weak direction, metres; nan without a map.
        strong_rmse: Across it.
        nees: Mean of e' P^-1 e over x, y and heading, with deviations of at least `LEAST_STD`; 3 is
            expected of a consistent estimate, nan where the covariance is singular throughout.
        exposure: Integral of the map's layer over the path truly driven, metres; nan without.
        length: Distance truly driven, metres.
        seconds: Duration of the run.
    """

    arrived: Bools
    collided: Bools
    lost: Bools
    lost_after: Floats
    lost_share: Floats
    position_rmse: Floats
    position_p95: Floats
    position_max: Floats
    heading_rmse: Floats
    heading_p95: Floats
    heading_max: Floats
    weak_rmse: Floats
    strong_rmse: Floats
    nees: Floats
    exposure: Floats
    length: Floats
    seconds: Floats

    def __len__(self) -> int:
        """Return the number of runs R."""
        return len(self.arrived)

    def row(self, run: int) -> dict[str, float | bool]:
        """Return all figures of one run by name."""
        return {field.name: getattr(self, field.name)[run].item() for field in fields(self)}


def metrics(drives: Drives, amap: AmbiguityMap | None = None, layer: str | None = None) -> Metrics:
    """Measure drives.

    Args:
        drives: The drives.
        amap: The map for the weak direction and the exposure.
        layer: The map's layer that makes the exposure; None: its `cost_layer`.

    Raises:
        InputError: the map has no such layer.
    """
    check_kind(drives, Drives, "drives", "give what `drive_route` returns")
    check_kind(amap, (AmbiguityMap, NoneType), "amap")
    errors = drives.errors()
    position, heading = np.hypot(errors[..., 0], errors[..., 1]), np.abs(errors[..., 2])
    far = (position > LOST_POSITION) | (heading > LOST_HEADING)
    lost_after = np.array([first_lost(drives.time, row) for row in far])
    truth = drives.truth
    ends = np.arange(len(drives)), drives.samples - 1
    last = truth[ends]
    near = np.hypot(last[:, 0] - drives.goal[0], last[:, 1] - drives.goal[1]) <= ARRIVAL
    # In open loop the robot follows the route whatever it believes.
    estimate = drives.estimate[ends]
    off = np.hypot(estimate[:, 0] - drives.goal[0], estimate[:, 1] - drives.goal[1])
    believed = (off <= ARRIVAL) | (not drives.open_loop)
    nothing = np.full(len(drives), math.nan)
    weak, strong, exposure = nothing, nothing, nothing
    if amap is not None:
        weak, strong = _along_and_across(errors, truth, amap)
        layer = amap.cost_layer if layer is None else layer
        amap.floor(layer)  # complains of a layer that is not there
        exposure = _exposure(truth, Field.of(amap, layer))
    return Metrics(
        arrived=drives.reached & near & believed,
        collided=drives.collided,
        lost=~np.isnan(lost_after),
        lost_after=lost_after,
        lost_share=far.sum(axis=1) / drives.samples,
        position_rmse=_rmse(position),
        position_p95=np.nanquantile(position, 0.95, axis=1),
        position_max=np.nanmax(position, axis=1),
        heading_rmse=_rmse(heading),
        heading_p95=np.nanquantile(heading, 0.95, axis=1),
        heading_max=np.nanmax(heading, axis=1),
        weak_rmse=weak,
        strong_rmse=strong,
        nees=_nees(errors, drives.covariance),
        exposure=exposure,
        length=drives.travelled()[ends],
        seconds=drives.seconds,
    )


def first_lost(time: Floats, far: Bools, seconds: float = LOST_SECONDS) -> float:
    """Return when a run's error has been too large for longer than `seconds`; nan if never.

    Args:
        time: Of the samples, shape (T,), seconds.
        far: Whether the error is too large, shape (T,).
        seconds: For how long it may be.
    """
    edges = np.flatnonzero(np.diff(far.astype(np.int8), prepend=0, append=0))
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        over = time[first:end] - time[first] > seconds + INSTANT
        if over.any():
            return float(time[first + int(over.argmax())])
    return math.nan


def _rmse(errors: Floats) -> Floats:
    return np.asarray(np.sqrt(np.nanmean(errors * errors, axis=1)))


def _along_and_across(errors: Floats, truth: Floats, amap: AmbiguityMap) -> tuple[Floats, Floats]:
    """Return RMSE along and across the weak direction; nan where the map has no value."""
    angle = np.asarray(amap.sample("direction", *np.moveaxis(truth, -1, 0)))
    c, s = np.cos(angle), np.sin(angle)
    parts = (c * errors[..., 0] + s * errors[..., 1], c * errors[..., 1] - s * errors[..., 0])
    is_known = ~np.isnan(parts[0])
    count = is_known.sum(axis=1)
    weak, strong = (
        np.sqrt(
            np.divide(
                np.nansum(part * part, axis=1), count,
                out=np.full(len(count), math.nan), where=count > 0,
            )
        )
        for part in parts
    )  # fmt: skip
    return weak, strong


def _exposure(truth: Floats, field: Field) -> Floats:
    """Integrate a field over the path of each run, shape (R,), metres."""
    out = np.zeros(len(truth))
    a, b = truth[:, :-1], truth[:, 1:]
    driven = np.isfinite(b[..., 0])
    xa, ya, ta = a[driven].T
    xb, yb, tb = b[driven].T
    parts = field.integral(xa, ya, ta, xb, yb, tb)
    np.add.at(out, np.nonzero(driven)[0], parts)
    return out


def _nees(errors: Floats, covariance: Floats) -> Floats:
    """Return each run's mean NEES, the normalized estimation error squared.

    See Bar-Shalom, Li and Kirubarajan 2001.
    """
    usable: Bools = np.asarray(np.isfinite(errors).all(axis=-1))
    # With few particles left the covariance may be rank-deficient, apart from rounding.
    spread, axes = np.linalg.eigh(covariance[usable])
    full = spread[:, 0] > FULL_RANK * spread[:, -1]
    along = (axes * errors[usable][:, :, None]).sum(axis=1)
    squared = np.full(usable.shape, math.nan)
    squared[usable] = np.where(
        full, (along**2 / np.maximum(spread, LEAST_STD**2)).sum(axis=-1), math.nan
    )
    is_known = ~np.isnan(squared)
    count = is_known.sum(axis=1)
    total = np.where(is_known, squared, 0.0).sum(axis=1)
    out = np.full(len(errors), math.nan)
    np.divide(total, count, out=out, where=count > 0)
    return out
