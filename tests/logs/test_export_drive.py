"""Drives for other people's tools, and the same result from what was written."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.drive.drive import drive_route
from ambinav.drive.robot import Robot
from ambinav.geometry.frames import wrap_angles
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.localization.parameters import MclParameters
from ambinav.logs.carmen import read_carmen
from ambinav.logs.export import load_tum
from ambinav.logs.export_drive import drive_log, export_drive
from ambinav.logs.replay import replay
from ambinav.runtime.errors import InputError
from ambinav.sensing import RangeScanner, RangeSensor
from tests.drive.cases import route_through

SENSOR = RangeSensor(
    max_range=4.0, min_range=0.1, std=0.02, resolution=0.001, random_share=0.02, lost_share=0.02
)
FAN = RangeScanner.planar(SENSOR, 45, 1.5 * math.pi, (0.1, -0.02, 0.3))
AROUND = RangeScanner.planar(SENSOR, 36, 2.0 * math.pi, (0.05, 0.0, 0.0))
FEW = MclParameters(min_particles=200, max_particles=400, likelihood_resolution=0.05)
SEED, RUNS, RUN = 5, 3, 1


class Watched(MonteCarloLocalizer):
    """Remembers where it was started."""

    def start(self, poses, covariance=None):
        self.begin = poses, covariance
        super().start(poses, covariance)


@pytest.fixture(scope="module")
def house():
    floor = shapely.Polygon([(0, 0), (6, 0), (6, 3), (4, 3), (4, 5), (0, 5)])
    return an.environment_from_shapes([floor])


def driven(house, scanner, **options):
    """A localizer's drive round the corner, and the same localizer as it was before."""
    watched, fresh = (
        kind(house, scanner, FEW, runs=RUNS, rng=np.random.default_rng(SEED))
        for kind in (Watched, MonteCarloLocalizer)
    )
    route = route_through([(1.0, 1.0), (4.5, 1.0), (4.5, 2.0)])
    rng = np.random.default_rng(2)
    drives = drive_route(house, scanner, Robot(), route, watched, rng, RUNS, **options)
    fresh.start(*watched.begin)
    return drives, fresh


def evo_reads(path):
    """As evo's read_tum_trajectory_file: csv with single blanks, 8 values in each row."""
    with path.open() as file:
        lines = (line for line in file if not line.startswith("#"))
        rows = list(csv.reader(lines, delimiter=" "))
    assert {len(row) for row in rows} == {8}
    table = np.array(rows).astype(float)
    assert (np.diff(table[:, 0]) > 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(table[:, 4:], axis=1), 1.0, atol=1e-12)
    return table


@pytest.mark.parametrize("scanner", [FAN, AROUND], ids=["fan", "around"])
def test_the_log_of_a_drive_replays_with_the_same_result(tmp_path, house, scanner):
    drives, localizer = driven(house, scanner, keep_ranges=True)
    files = export_drive(drives, RUN, tmp_path / "run", scanner)
    assert {file.name for file in files} == {file.name for file in (tmp_path / "run").iterdir()}
    log = read_carmen(tmp_path / "run" / "drive.log")
    log.check_scanner(scanner)
    n = int(drives.samples[RUN])
    np.testing.assert_array_equal(log.time, drives.time[:n])
    np.testing.assert_array_equal(log.odometry, drives.odometry[RUN, :n])
    np.testing.assert_array_equal(log.ranges, drives.ranges[RUN, :n])
    np.testing.assert_allclose(log.poses, drives.truth[RUN, :n], atol=1e-12)
    assert np.isposinf(log.ranges).any()
    # To the last bit what the localizer made of the drive itself.
    found = replay(log, localizer, scanner)
    expected = drives.estimate[RUN, :n]
    np.testing.assert_array_equal(found.estimates[RUN, :, :2], expected[:, :2])
    np.testing.assert_allclose(found.estimates[RUN, :, 2], wrap_angles(expected[:, 2]), atol=1e-12)
    np.testing.assert_array_equal(found.updated[RUN], drives.updated[RUN, :n])


def test_trajectories_and_table(tmp_path, house):
    drives, _ = driven(house, AROUND)
    names = ["truth.tum", "estimate.tum", "odometry.tum", "drive.csv"]
    files = export_drive(drives, RUN, tmp_path)
    assert [file.name for file in files] == names
    n = int(drives.samples[RUN])
    tracks = dict(zip(names, (drives.truth, drives.estimate, drives.odometry), strict=False))
    for name, track in tracks.items():
        rows = evo_reads(tmp_path / name)
        np.testing.assert_array_equal(rows[:, 0], drives.time[:n])
        np.testing.assert_array_equal(rows[:, 1:3], track[RUN, :n, :2])
        heading = load_tum(tmp_path / name)[1][:, 2]
        np.testing.assert_allclose(wrap_angles(heading - track[RUN, :n, 2]), 0.0, atol=1e-12)
    with (tmp_path / "drive.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == n
    last = rows[-1]
    for column, value in {
        "sample": n - 1,
        "time": drives.time[n - 1],
        "odometry_x": drives.odometry[RUN, n - 1, 0],
        "y": drives.truth[RUN, n - 1, 1],
        "estimate_theta": drives.estimate[RUN, n - 1, 2],
        "covariance_x_theta": drives.covariance[RUN, n - 1, 0, 2],
        "covariance_theta_theta": drives.covariance[RUN, n - 1, 2, 2],
    }.items():
        assert float(last[column]) == value
    assert [row["updated"] for row in rows] == ["01"[int(u)] for u in drives.updated[RUN, :n]]
    before = [file.read_bytes() for file in files]
    assert [file.read_bytes() for file in export_drive(drives, RUN, tmp_path)] == before


def test_the_log_of_a_laser_upside_down_is_reversed(tmp_path, house):
    hung = RangeScanner.from_mounts(SENSOR, FAN.mounts[::-1])
    drives, _ = driven(house, hung, keep_ranges=True)
    export_drive(drives, RUN, tmp_path, hung)
    log = read_carmen(tmp_path / "drive.log")
    log.check_scanner(FAN)
    np.testing.assert_array_equal(log.ranges, drives.ranges[RUN, : log.scans, ::-1])


def test_what_cannot_be_exported(tmp_path, house):
    drives, _ = driven(house, AROUND, keep_ranges=True)
    ring = RangeScanner.ring(SENSOR, AROUND.beams, 0.2)
    mounts = AROUND.mounts.copy()
    mounts[3, 2] += 0.02
    uneven = RangeScanner.from_mounts(SENSOR, mounts)
    layers = RangeScanner.from_preset("velodyne-vlp-16")
    of_layers = replace(drives, ranges=np.ones((RUNS, drives.ranges.shape[1], layers.beams)))
    for run, scanner, words in (
        (RUNS, AROUND, f"run is {RUNS}; there are the runs 0 to {RUNS - 1}"),
        (-1, None, "run is -1"),
        (RUN, FAN, "a scan has 36 readings and scanner 'planar scanner' has 45 beams"),
        (RUN, ring, "scanner 'ring': its beams start in several places"),
        (RUN, uneven, "not evenly spread"),
    ):
        with pytest.raises(InputError, match=words):
            export_drive(drives, run, tmp_path / "none", scanner)
    with pytest.raises(InputError, match="its beams look up or down"):
        export_drive(of_layers, RUN, tmp_path / "none", layers)
    log = drive_log(drives, RUN, AROUND)
    log = replace(log, angles=np.zeros(layers.beams), ranges=np.ones((log.scans, layers.beams)))
    with pytest.raises(InputError, match="its beams are level, and those of"):
        log.check_scanner(layers)
    bare = replace(drives, ranges=None)
    with pytest.raises(InputError, match="the readings were not kept"):
        export_drive(bare, RUN, tmp_path / "none", AROUND)
    assert not (tmp_path / "none").exists()
    with pytest.raises(InputError, match="readings were not kept"):
        drive_log(bare, RUN, AROUND)
