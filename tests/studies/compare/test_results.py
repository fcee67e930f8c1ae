"""What is kept of drives."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from ambinav.drive.drives import Drives
from ambinav.drive.metrics import Metrics, metrics
from ambinav.drive.world import COLLIDED, REACHED
from ambinav.studies.compare.results import (
    STEP,
    joined,
    load_results,
    quantiles,
    results_of,
    save_results,
)


def drives() -> Drives:
    """Two runs of 4 m at 0.1 m a sample: the second ends half way, 0.8 m off from 1 m on."""
    count = 41
    truth = np.zeros((2, count, 3))
    truth[:, :, 0] = 0.1 * np.arange(count)
    estimate = truth.copy()
    estimate[0, :, 1] = 0.1
    estimate[1, 10:, 1] = 0.8
    covariance = np.tile(np.eye(3), (2, count, 1, 1))
    for rows in (truth, estimate, covariance):
        rows[1, 21:] = np.nan
    return Drives(
        0.2 * np.arange(count), truth, truth.copy(), estimate, covariance,
        np.ones((2, count), dtype=np.bool_), np.array([count, 21]),
        np.array([REACHED, COLLIDED]), (4.0, 0.0, 0.0), 4.0, False, None,
    )  # fmt: skip


def test_stations() -> None:
    found = results_of(drives(), metrics(drives()), 4.0)
    assert found.errors.shape == (2, 1 + round(4.0 / STEP))
    np.testing.assert_allclose(found.errors[0], 0.1)
    np.testing.assert_allclose(found.errors[1], [0.0, 0.0, 0.8, 0.8, 0.8, *[np.nan] * 4])
    np.testing.assert_allclose(found.end, [[4.0, 0.0], [2.0, 0.0]])
    assert np.isnan(found.lost_at[0]).all()
    # Too far off from 1 m on, and lost after more than a second of it, at half a metre a second.
    np.testing.assert_allclose(found.lost_at[1], [1.6, 0.0])


def test_quantiles_are_of_those_still_driving() -> None:
    errors = np.array([[1.0, 1.0, np.nan], *[[3.0, np.nan, np.nan]] * 4])
    np.testing.assert_allclose(quantiles(errors[:4], [0.0, 1.0]), [[1, 1, np.nan], [3, 1, np.nan]])
    # One of five is less than a quarter.
    np.testing.assert_allclose(quantiles(errors, [0.5])[0], [3.0, np.nan, np.nan])


def test_stored_and_read(tmp_path: Path) -> None:
    found = results_of(drives(), metrics(drives()), 4.0)
    path = tmp_path / "a.npz"
    save_results(found, path)
    back = load_results(path)
    assert back is not None
    for field in fields(Metrics):
        np.testing.assert_array_equal(
            getattr(back.metrics, field.name), getattr(found.metrics, field.name)
        )
    np.testing.assert_array_equal(back.errors, found.errors)
    assert len(joined([found, back])) == 4


def test_a_damaged_file_is_none(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert load_results(path) is None
    save_results(results_of(drives(), metrics(drives()), 4.0), path)
    path.write_bytes(path.read_bytes()[:1000])
    assert load_results(path) is None
