"""Logs of real robots through Monte Carlo localization: errors that were reached, with slack.

The figures of more runs, and of AMCL's defaults, are in benchmarks/results/replay.md.
"""

from __future__ import annotations

import gzip
import math
from dataclasses import replace

import numpy as np
import pytest

from ambinav.buildings.load import load_environment
from ambinav.geometry.frames import between
from ambinav.localization.mcl import MonteCarloLocalizer
from ambinav.logs.carmen import read_carmen
from ambinav.logs.grid_map import map_from_log
from ambinav.logs.localize import SPARSE_SCANS, localize
from ambinav.logs.registration import register
from ambinav.logs.replay import replay
from ambinav.runtime.errors import InputError, InputWarning

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

# The laser of the hall's robot, as its original log says; the CARMEN text cannot show it, since
# its odometry is in a frame of its own.
HALL_MOUNT = (0.095, 0.0, 0.0)
RUNS = 5


@pytest.fixture(scope="module")
def hall(data_dir):
    log = read_carmen(data_dir / "logs" / "mrpt_uwb_hall_gt.log.gz", mount=HALL_MOUNT)
    return log, load_environment(data_dir / "maps" / "mrpt_uwb_hall.yaml")


@pytest.fixture(scope="module")
def halves(data_dir):
    def split(name):
        log = read_carmen(data_dir / "logs" / f"{name}-corrected.log.gz")
        first, rest = log.every(2)
        return rest, map_from_log(first)

    return {name: split(name) for name in ("intel", "aces")}


@pytest.mark.slow(kept=("2",))
@pytest.mark.parametrize("seed", [1, 2])
def test_the_hall_with_its_own_map_and_ground_truth(hall, seed):
    """At most 10 cm, once the ground truth is in the frame of the map; 13 cm as published.

    The motion between the two frames comes from the scans of the first half alone; the errors
    are those of the second.
    """
    log, environment = hall
    found = localize(log, environment, SPARSE_SCANS, rng=np.random.default_rng(seed), runs=RUNS)
    assert not found.lost.any()
    half = log.scans // 2
    raw = found.errors(half)
    assert 0.12 < raw.position_median < 0.14
    assert raw.position_95 < 0.25
    frame = register(log.chosen(slice(0, half)), environment)
    errors = replace(found, log=frame.applied(log)).errors(half)
    assert errors.position_median < 0.067
    assert errors.position_95 < 0.17
    assert errors.position_max < 0.20
    assert math.degrees(errors.heading_median) < 0.8
    # As evo_ape --align would have it, from the estimates themselves.
    aligned = found.aligned().errors()
    assert aligned.position_median < 0.07
    assert aligned.position_95 < 0.155


def test_the_frames_of_the_hall_differ_whichever_scans_are_asked(hall):
    """Each part of the log shows the same turn and shift, and no localizer has a say in it."""
    log, environment = hall
    middle = np.array([5.6, -1.1, 0.0])
    moved = []
    for part in np.array_split(np.arange(log.scans), 3):
        found = register(log.chosen(part), environment)
        assert found.after < 0.75 * found.before
        c, s = math.cos(found.motion[2]), math.sin(found.motion[2])
        x, y, _ = middle
        place = found.motion[0] + c * x - s * y, found.motion[1] + s * x + c * y
        moved.append([place[0] - x, place[1] - y, found.motion[2]])
    np.testing.assert_allclose([m[1] for m in moved], -0.07, atol=0.025)
    np.testing.assert_allclose([m[2] for m in moved], 0.021, atol=0.006)


@pytest.mark.slow(kept=("aces",))
@pytest.mark.parametrize("name", ["intel", "aces"])
def test_logs_in_the_map_s_own_frame_stay_where_they_are(halves, name):
    log, environment = halves[name]
    found = register(log, environment)
    np.testing.assert_allclose(found.motion, 0.0, atol=0.01)
    assert found.before - found.after < 0.002


@pytest.mark.slow(kept=("aces-0.36-1",))
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize(("name", "heading"), [("intel", 0.55), ("aces", 0.36)])
def test_replayed_on_the_map_of_the_other_scans(halves, name, heading, seed):
    """Scans 1 to 2 m apart, from odometry that leads tens of metres astray by itself."""
    log, environment = halves[name]
    found = localize(log, environment, SPARSE_SCANS, rng=np.random.default_rng(seed), runs=RUNS)
    assert not found.lost.any()
    errors = found.errors()
    assert errors.position_median < 0.058
    assert errors.position_95 < 0.147
    assert errors.position_max < 0.35
    assert math.degrees(errors.heading_median) < heading
    assert math.degrees(errors.heading_max) < 8.0
    # Every run by itself, not only all together.
    assert np.median(found.position_error, axis=1).max() < 0.06
    alone = between(log.odometry[0], log.odometry) - between(log.poses[0], log.poses)
    assert np.hypot(alone[:, 0], alone[:, 1]).max() > 10.0


def test_the_same_seed_gives_the_same_estimates(halves):
    log, environment = halves["aces"]
    log = log.chosen(slice(0, 40))
    one, two, other = (
        localize(log, environment, SPARSE_SCANS, rng=np.random.default_rng(seed), runs=2)
        for seed in (4, 4, 5)
    )
    np.testing.assert_array_equal(one.estimates, two.estimates)
    assert not np.array_equal(one.estimates, other.estimates)


def test_the_wrong_map_or_scanner_is_refused(halves, hall):
    log, environment = halves["intel"]
    aces, rng = halves["aces"][0], np.random.default_rng(1)
    away = replace(log, poses=log.poses + np.array([200.0, 0.0, 0.0]))
    with pytest.raises(InputError, match=r"intel.*: 0 of its 455 poses lie in the free space"):
        localize(away, environment, SPARSE_SCANS, rng=rng)
    with pytest.raises(InputError, match="poses lie in the free space of environment 'mrpt_uwb_h"):
        localize(aces, hall[1], SPARSE_SCANS, rng=rng)
    scanner = hall[0].scanner()
    localizer = MonteCarloLocalizer(environment, scanner, SPARSE_SCANS, rng=rng)
    localizer.start(log.poses[0])
    with pytest.raises(InputError, match=r"intel.*180 beams and scanner .* has 361"):
        replay(log, localizer, scanner)


def test_a_real_log_with_lines_that_are_cut_off(tmp_path, data_dir):
    whole = read_carmen(data_dir / "logs" / "aces-corrected.log.gz")
    text = gzip.decompress((data_dir / "logs" / "aces-corrected.log.gz").read_bytes()).decode()
    lines = text.splitlines()
    scans = [k for k, line in enumerate(lines) if line.startswith("FLASER")]
    path = tmp_path / "aces.log"
    for cut in (1, 4, 5):
        gone = [scans[100 * (k % 4) + k] for k in range(cut)]
        bad = [line[: len(line) // 2] if k in gone else line for k, line in enumerate(lines)]
        path.write_text("\n".join(bad))
        if cut > 0.01 * len(scans):
            with pytest.raises(InputError, match=rf"line {min(gone) + 1}: .*5 of 440 FLASER"):
                read_carmen(path)
            continue
        with pytest.warns(InputWarning, match=rf"{cut} damaged lines? w.*line {min(gone) + 1}:"):
            log = read_carmen(path)
        assert (log.scans, log.skipped) == (whole.scans - cut, cut)
        kept = np.isin(scans, gone, invert=True)
        np.testing.assert_array_equal(log.poses, whole.poses[kept])
        # The odometry goes on across the gap.
        steps = between(log.odometry[:-1], log.odometry[1:])
        expected = between(whole.odometry[kept][:-1], whole.odometry[kept][1:])
        assert np.hypot(*(steps - expected)[:, :2].T).max() < 0.5
    # A download that broke off: the last line is a torn scan.
    end = text.index("\n", text.rindex("FLASER")) - 300
    path.write_text(text[:end])
    with pytest.warns(InputWarning, match="1 damaged line was left out"):
        assert read_carmen(path).scans == whole.scans - 1
