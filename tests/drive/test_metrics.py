"""Figures of drives that were made up by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ambinav.drive.drives import Drives
from ambinav.drive.metrics import metrics
from ambinav.drive.world import COLLIDED, REACHED, TIMED_OUT
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.errors import InputError
from ambinav.service.service import AmbiguityService
from tests.maps import synthetic

DT = 0.1


def made_up(
    errors: np.ndarray, *, truth: np.ndarray | None = None, outcome: int = REACHED,
    covariance: np.ndarray | None = None,
) -> Drives:  # fmt: skip
    """One run along x at 0.5 m/s from (5, 2) with given errors of the estimate, shape (T, 3)."""
    count = len(errors)
    if truth is None:
        truth = np.column_stack(
            [5.0 + 0.05 * np.arange(count), np.full(count, 2.0), np.zeros(count)]
        )
    spread = np.eye(3) if covariance is None else covariance
    x, y, t = truth[-1].tolist()
    return Drives(
        time=DT * np.arange(count), truth=truth[None], odometry=np.zeros((1, count, 3)),
        estimate=(truth + errors)[None], covariance=np.tile(spread, (1, count, 1, 1)),
        updated=np.ones((1, count), dtype=bool), samples=np.array([count]),
        outcome=np.array([outcome]), goal=(x, y, t), length=0.05 * (count - 1), open_loop=False,
        ranges=None,
    )  # fmt: skip


def bad_for(samples: int, size: tuple[float, float, float], first: int = 20) -> np.ndarray:
    """Errors of 60 samples that are of a size for some, and none otherwise."""
    errors = np.zeros((60, 3))
    errors[first : first + samples] = size
    return errors


@pytest.mark.parametrize(
    "size", [(0.51, 0.0, 0.0), (0.4, -0.4, 0.0), (0.0, 0.0, math.radians(-30.1))]
)
def test_a_robot_is_lost_after_more_than_a_second(size: tuple[float, float, float]) -> None:
    # 11 samples are 1.0 s from the first to the last: not yet.
    kept = metrics(made_up(bad_for(11, size)))
    assert not kept.lost[0] and math.isnan(kept.lost_after[0])
    assert kept.lost_share[0] == pytest.approx(11 / 60)
    lost = metrics(made_up(bad_for(12, size)))
    assert lost.lost[0] and lost.lost_after[0] == pytest.approx(3.1)


def test_smaller_errors_and_broken_ones_lose_nobody() -> None:
    limit = (0.3, 0.4, math.radians(29.9))
    assert not metrics(made_up(bad_for(40, limit) * (1 - 1e-9))).lost[0]
    errors = bad_for(30, (0.6, 0.0, 0.0))
    errors[[27, 35, 43]] = 0.0
    assert not metrics(made_up(errors)).lost[0]


def test_errors_are_those_of_plain_numpy() -> None:
    rng = np.random.default_rng(1)
    errors = rng.normal(0.0, [0.1, 0.2, 0.05], (60, 3))
    found = metrics(made_up(errors))
    position = np.hypot(errors[:, 0], errors[:, 1])
    assert found.position_rmse[0] == pytest.approx(math.sqrt((position**2).mean()))
    assert found.position_p95[0] == pytest.approx(np.quantile(position, 0.95))
    assert found.position_max[0] == pytest.approx(position.max())
    assert found.heading_rmse[0] == pytest.approx(math.sqrt((errors[:, 2] ** 2).mean()))
    assert found.heading_p95[0] == pytest.approx(np.quantile(np.abs(errors[:, 2]), 0.95))
    assert found.heading_max[0] == pytest.approx(np.abs(errors[:, 2]).max())
    assert found.length[0] == pytest.approx(0.05 * 59)
    assert made_up(errors).travelled()[0] == pytest.approx(0.05 * np.arange(60))
    assert found.seconds[0] == pytest.approx(5.9)
    assert found.row(0)["seconds"] == pytest.approx(5.9)


def test_headings_are_compared_the_short_way_round() -> None:
    assert metrics(made_up(np.full((20, 3), [0.0, 0.0, 2 * math.pi - 0.1]))).heading_max[
        0
    ] == pytest.approx(0.1)


def test_consistency_is_the_mean_squared_error_in_deviations() -> None:
    covariance = np.diag([0.04, 0.01, 0.0025])
    covariance[0, 1] = covariance[1, 0] = 0.01
    errors = np.tile([0.2, -0.1, 0.1], (30, 1))
    want = errors[0] @ np.linalg.inv(covariance) @ errors[0]
    assert metrics(made_up(errors, covariance=covariance)).nees[0] == pytest.approx(want)
    nothing = metrics(made_up(errors, covariance=np.zeros((3, 3))))
    assert math.isnan(nothing.nees[0])
    draws = np.random.default_rng(2).multivariate_normal(np.zeros(3), covariance, 4000)
    assert metrics(made_up(draws, covariance=covariance)).nees[0] == pytest.approx(3.0, abs=0.2)


def test_a_covariance_without_full_rank_tells_no_consistency() -> None:
    errors = np.full((5, 3), 0.01)
    # Of two particles: rounding makes some of the eigenvalues that are 0 a little more than that.
    apart = np.random.default_rng(0).normal(size=(50, 3))
    flat = apart[:, :, None] * apart[:, None, :]
    assert (np.linalg.eigvalsh(flat)[:, 0] > 0.0).any()
    for covariance in flat:
        assert math.isnan(metrics(made_up(errors, covariance=covariance)).nees[0])
    # However small, it counts if it has, but for no less than 0.5 mm and 0.5 mrad.
    small = metrics(made_up(errors, covariance=1e-6 * np.eye(3)))
    assert small.nees[0] == pytest.approx(300.0)
    smaller = metrics(made_up(errors, covariance=1e-9 * np.eye(3)))
    assert smaller.nees[0] == pytest.approx(1200.0)


def test_one_update_with_a_few_particles_does_not_decide_consistency() -> None:
    """Three particles that are nearly in a plane: a millionth of a metre across it."""
    errors = np.tile([0.03, 0.02, 0.01], (400, 1))
    drives = made_up(errors, covariance=np.diag(errors[0] ** 2))
    covariance = drives.covariance.copy()
    covariance[0, 40] = np.diag([0.017, 0.004, 7e-7]) ** 2
    assert metrics(drives).nees[0] == pytest.approx(3.0)
    assert metrics(replace(drives, covariance=covariance)).nees[0] < 5.0


def test_arrival_is_judged_by_the_truth() -> None:
    there = made_up(np.zeros((10, 3)))
    assert metrics(there).arrived[0] and not metrics(there).collided[0]
    for goal, arrived in (((5.9, 2.0, 0.0), True), ((6.0, 2.0, 0.0), False)):
        run = made_up(np.zeros((10, 3)))
        object.__setattr__(run, "goal", goal)
        assert metrics(run).arrived[0] == arrived
    assert not metrics(made_up(np.zeros((10, 3)), outcome=TIMED_OUT)).arrived[0]
    hit = metrics(made_up(np.zeros((10, 3)), outcome=COLLIDED))
    assert hit.collided[0] and not hit.arrived[0]


def test_in_a_corridor_the_weak_direction_is_along_it() -> None:
    amap = AmbiguityMap(synthetic.dataset())
    found = metrics(made_up(np.tile([0.3, -0.1, 0.0], (60, 1))), amap)
    assert (found.weak_rmse[0], found.strong_rmse[0]) == pytest.approx((0.3, 0.1))
    # From x = 5 on the corridor's level is 0.5 everywhere.
    assert found.exposure[0] == pytest.approx(0.5 * 0.05 * 59)
    none = metrics(made_up(np.zeros((10, 3))))
    assert math.isnan(none.weak_rmse[0]) and math.isnan(none.exposure[0])


def test_the_exposure_is_that_of_the_service() -> None:
    amap = AmbiguityMap(synthetic.dataset())
    truth = np.column_stack([np.linspace(2.0, 20.0, 91), np.linspace(2.0, 1.5, 91), np.zeros(91)])
    found = metrics(made_up(np.zeros((91, 3)), truth=truth), amap)
    assert found.exposure[0] == pytest.approx(AmbiguityService(amap).route_exposure(truth))
    with pytest.raises(InputError, match="no such layer"):
        metrics(made_up(np.zeros((9, 3))), amap, "levels")


def test_what_comes_after_the_end_of_a_run_does_not_count() -> None:
    one = made_up(np.tile([0.3, 0.4, 0.1], (30, 1)))
    padded = Drives(
        time=DT * np.arange(40),
        **{
            name: np.concatenate(
                [getattr(one, name), np.full_like(getattr(one, name)[:, :10], np.nan)], axis=1
            )
            for name in ("truth", "odometry", "estimate", "covariance")
        },
        updated=np.zeros((1, 40), dtype=bool), samples=one.samples, outcome=one.outcome,
        goal=one.goal, length=one.length, open_loop=False, ranges=None,
    )  # fmt: skip
    amap = AmbiguityMap(synthetic.dataset())
    a, b = metrics(one, amap).row(0), metrics(padded, amap).row(0)
    assert a == pytest.approx(b, nan_ok=True)
    assert len(metrics(padded)) == 1
