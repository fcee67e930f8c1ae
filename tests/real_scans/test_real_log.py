"""A whole log: its parts, refusals, and the study of one that is simulated and one that is real."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import shapely
from real_scans.log_split import as_seen_from_laser, check_scans, stretches
from real_scans.plot_real_log import plot_real_log
from real_scans.rank_agreement import spearman
from real_scans.real_log import parts_of, study_log

from ambinav.logs.carmen import read_carmen
from ambinav.runtime.errors import InputError
from tests.real_scans.rooms import drive, environment, log_of


@pytest.fixture(scope="module")
def log():
    return log_of(environment(), drive(), noise=0.01, mount=(0.1, 0.0, 0.0))


@pytest.fixture(scope="module")
def study(log):
    return study_log(log, 4.0, environment=environment(), spacing=0.25, pair_radius=1.0)


def test_stretches_take_turns(log):
    half = stretches(log, 5.0)
    assert 0.4 < half.mean() < 0.6
    assert 5 < np.flatnonzero(np.diff(half)).size < 12
    assert set(stretches(log, 5.0, 4).tolist()) == {0, 1, 2, 3}


def test_the_parts_judge_each_other(log):
    (first, by_first), (second, by_second) = parts_of(log, None)
    assert (by_first ^ by_second).all()
    assert first.segments.xy.shape != second.segments.xy.shape


def test_seen_from_the_laser(log):
    seen = as_seen_from_laser(replace(log, angles=log.angles[::-1], ranges=log.ranges[:, ::-1]))
    assert seen.mount == (0.0, 0.0, 0.0)
    np.testing.assert_allclose(seen.poses, log.laser_poses)
    np.testing.assert_array_equal(seen.ranges, log.ranges)


@pytest.mark.slow
def test_where_the_walls_are_known_prediction_and_measurement_agree(study):
    pairs = study.pairs
    # The drive's places are of few kinds, and within a kind noise alone orders the pairs.
    assert spearman(pairs.predicted, pairs.measured) > 0.85
    assert np.median(np.abs(pairs.predicted - pairs.measured)) < 0.7
    assert spearman(pairs.predicted_rank, pairs.measured_rank) > 0.4
    # So for the level: most of the drive is one corridor.
    apart = np.abs(study.map_says["level"] - study.scan_says["level"])
    assert np.median(apart) < 0.02
    assert np.quantile(apart, 0.9) < 0.06
    assert study.map_says["level"].max() - study.map_says["level"].min() > 0.4


@pytest.mark.slow
def test_picture(study):
    figure = plot_real_log(study)
    zones, level = figure.axes
    assert len(level.child_axes) == 1 and not zones.child_axes  # the scale of the level
    dots = [c for c in zones.collections if len(c.get_offsets()) > 5]
    assert dots


def test_a_log_of_another_building_is_refused(log):
    far = environment(shapely.box(500, 500, 510, 510))
    with pytest.raises(InputError, match="give the map that belongs to the log"):
        study_log(log, environment=far)


def test_a_log_whose_scans_are_not_those_of_the_map_is_refused(log):
    hall = environment(shapely.box(-60, -40, 70, 50))
    with pytest.raises(InputError, match="of its readings are within"):
        check_scans(as_seen_from_laser(log), hall)


def test_too_short_to_part(log):
    short = log.chosen(slice(0, 5))
    with pytest.raises(InputError, match="fewer than 2 stretches"):
        study_log(short)
    with pytest.raises(InputError, match="parts is 1"):
        study_log(log, parts=1)


def test_without_poses_and_with_one_beam(log):
    with pytest.raises(InputError, match="no poses"):
        study_log(replace(log, poses=None))
    one = replace(log, angles=log.angles[:1], ranges=log.ranges[:, :1])
    with pytest.raises(InputError, match="one beam"):
        study_log(one)


def test_scans_too_far_apart(log):
    with pytest.raises(InputError, match="no two scans"):
        study_log(log, 4.0, environment=environment(), pair_radius=0.0501, spacing=0.5)


@pytest.mark.slow
def test_a_real_log(data_dir):
    log = read_carmen(data_dir / "logs" / "aces-corrected.log.gz").chosen(slice(0, 150))
    study = study_log(log, 4.0, spacing=0.3)
    assert len(study.pairs.first) > 200
    assert spearman(study.predicted["ambiguity"], study.measured["ambiguity"]) > 0.5
    assert spearman(study.pairs.predicted, study.pairs.measured) > 0.6
