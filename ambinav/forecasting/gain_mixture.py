"""Forecasts of a class of localizers whose robots gain different shares of what scans tell."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.noise import OdometryNoise
from ambinav.forecasting.filter_kernel import FilterSettings, forecast_rows
from ambinav.forecasting.information_field import InformationField
from ambinav.runtime.threads import run_rows

Floats = NDArray[np.float64]


def forecast_poses(
    field: InformationField,
    poses: Floats,
    first: NDArray[np.int64],
    start: Floats,
    noise: OdometryNoise,
    settings: Sequence[FilterSettings],
    threads: bool = False,
) -> tuple[Floats, Floats]:
    """Forecast routes by a filter for each gain; robots are lost in the mean over them.

    Args:
        field: Information of the map's scans.
        poses: Poses along all routes, an update apart, (M, 3), metres and radians, map frame.
        first: Row of each route's first pose, and of the end of the last, shape (K + 1,).
        start: Covariance at the first pose of each, shape (3, 3).
        noise: Errors of the odometry.
        settings: Of each gain, the largest first (`LocalizerClass.settings`).
        threads: Share the routes among threads; not within what a thread does.

    Returns:
        Covariances of robots that are not lost, which is of the largest gain, since those who gain
        less are lost where it matters, (M, 3, 3); and shares lost up to each pose, before
        calibration, (M,).
    """
    covariances, shares = [], []
    for own in settings:
        covariance, lost = np.empty((len(poses), 3, 3)), np.empty(len(poses))
        arguments = (
            first, poses, start, field.fields, field.lattice, noise.packed, own, covariance, lost,
        )  # fmt: skip
        if threads:
            run_rows(forecast_rows, len(first) - 1, *arguments, least=8)
        else:
            forecast_rows(0, len(first) - 1, *arguments)
        covariances.append(covariance)
        shares.append(lost)
    return covariances[0], np.mean(shares, axis=0)
