"""Subsets of beams: measured as a scanner of those beams is, chosen, and written."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import shapely
import yaml

import ambinav as an
from ambinav.ambiguity.model import independent_tau
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.layout import Mounts, Part, Planar, Ring
from ambinav.studies.design.beams.choose import choose
from ambinav.studies.design.beams.loss import Loss
from ambinav.studies.design.beams.sample import MapSample, draw_samples, subset_tau
from ambinav.studies.design.beams.scanner import laser_filters_text, scan_masks, subset_scanner
from ambinav.studies.design.beams.search import at_random, best_of_all, even, grow, objective
from tests.geometry import scenes

SPACING, RADIUS = 0.25, 0.5
SENSOR = an.RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
CONE = an.RangeSensor(max_range=3.0, std=0.03, resolution=0.01, aperture=0.5)


def scanner(beams: int, aperture: float = math.tau) -> an.RangeScanner:
    return an.RangeScanner.planar(SENSOR, beams, aperture)


def samples(
    full: an.RangeScanner, places: int = 30, seed: int = 1, **given: object
) -> tuple[MapSample, ...]:
    env = scenes.scene(seed, size=6.0, blocks=4, thin=2)
    rng = np.random.default_rng(seed)
    return draw_samples(env, full, places, rng, spacing=SPACING, radius=RADIUS, **given)  # type: ignore[arg-type]


def level_of_map(
    full: an.RangeScanner, beams: list[int], sample: MapSample
) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """The same poses out of a whole map that is built of a scanner with those beams."""
    env = sample.groups[0].around.lattice.environment
    amap = an.build_map(
        env, subset_scanner(full, beams), SPACING, RADIUS, headings=1,
        max_beams=full.beams, tau=subset_tau(full, len(beams)), store=False,
    )  # fmt: skip
    (group,) = sample.groups
    around = group.around
    x, y = around.lattice.points
    dataset = amap.dataset["level"].isel(theta=0)
    found = dataset.sel(x=x[around.poses], y=y[around.poses], method="nearest").values
    return np.asarray(np.diag(found) if found.ndim == 2 else found, dtype=np.float64)


@pytest.mark.parametrize("aperture", [math.tau, math.pi])
@pytest.mark.parametrize("kept", [range(24), range(0, 24, 4), (0, 1, 7, 20)])
def test_a_subset_is_measured_as_a_map_of_a_scanner_with_those_beams(
    aperture: float, kept: tuple[int, ...]
) -> None:
    full = scanner(24, aperture)
    (sample,) = samples(full, samples=1, headings=np.zeros(1))
    level, _ = sample.measure(kept)
    np.testing.assert_allclose(level, level_of_map(full, list(kept), sample), atol=1e-6)


@pytest.mark.parametrize("kept", [range(24), (0, 5, 6, 13, 20, 23)])
def test_where_there_are_reflectors_intensities_are_measured_too(kept: Sequence[int]) -> None:
    """Half of the beams read them."""
    seeing = replace(SENSOR, intensity=Intensity(wall=100.0, reflector=400.0, std=60.0))
    mounts = an.RangeScanner.planar(SENSOR, 24, math.tau).mounts
    full = an.RangeScanner.from_mounts((SENSOR, seeing), mounts, np.arange(24) % 2)
    env = an.environment_from_shapes(
        [shapely.box(0, 0, 10, 2)], reflectors=[[(x, 0.0), (x + 0.3, 0.0)] for x in (3.0, 7.0)]
    )
    (sample,) = draw_samples(
        env, full, 30, np.random.default_rng(1), spacing=SPACING, radius=RADIUS, samples=1,
        headings=np.zeros(1),
    )  # fmt: skip
    assert len(sample.table.intensity) == 12
    level, _ = sample.measure(kept)
    np.testing.assert_allclose(level, level_of_map(full, list(kept), sample), atol=1e-6)
    grown = next(found for found in grow([sample], np.random.default_rng(0)) if len(found) == 3)
    rivals = [objective([sample], (*grown[:2], b)) for b in range(24) if b not in grown[:2]]
    assert objective([sample], grown) == pytest.approx(min(rivals), abs=1e-4)


def test_with_all_beams_nothing_is_lost() -> None:
    for one in samples(scanner(24)):
        loss = one.loss(range(24))
        assert loss.points == pytest.approx(0.0, abs=1e-4)


def test_of_beams_that_are_all_there_twice_half_lose_nothing() -> None:
    once = scanner(30)
    twice = an.RangeScanner.mixed(once, once)
    assert twice.beams == 60
    sample, _ = samples(twice)
    assert sample.loss(range(30)).points == pytest.approx(0.0, abs=1e-4)
    assert sample.loss(range(0, 60, 2)).points > 0.1


@pytest.mark.parametrize(("beams", "aperture"), [(360, math.tau), (682, 4.18), (8, 1.0)])
def test_pieces_of_evidence_stay_until_there_are_fewer_beams(beams: int, aperture: float) -> None:
    full = scanner(beams, aperture)
    pieces = beams / independent_tau(full)
    assert subset_tau(full, beams) == pytest.approx(independent_tau(full))
    for kept in range(1, beams + 1):
        assert kept / subset_tau(full, kept) == pytest.approx(min(kept, pieces))


def test_the_loss_is_the_larger_of_zones_and_level() -> None:
    full = np.array([0, 0, 2, 3], dtype=np.uint8)
    now = np.array([0, 1, 2, 2], dtype=np.uint8)
    loss = Loss.between(
        np.array([0.1, 0.2, 0.5, 0.7]), now, np.array([0.1, 0.1, 0.6, 0.9]), full, np.full(4, 0.25)
    )
    assert loss.zones == pytest.approx(25.0)
    assert loss.level == pytest.approx(10.0)
    assert loss.points == loss.zones
    assert Loss.worst([loss, Loss(1.0, 40.0)]) == Loss(loss.zones, 40.0)


def test_greedy_adds_the_beam_that_leaves_least() -> None:
    full = an.RangeScanner.mixed(scanner(8), an.RangeScanner.ring(CONE, 4, 0.1))
    both = list(samples(full, places=12))
    kept: tuple[int, ...] = ()
    for found in grow(both, np.random.default_rng(0)):
        rivals = {b: objective(both, (*kept, b)) for b in range(full.beams) if b not in kept}
        assert found[:-1] == kept
        assert objective(both, found) == pytest.approx(min(rivals.values()), abs=1e-4)
        kept = found
    assert sorted(kept) == list(range(12))


def test_the_best_of_all_subsets_is_the_best_and_greedy_is_no_better() -> None:
    sample = samples(scanner(7), places=12)[:1]
    for count, greedy in enumerate(grow(sample, np.random.default_rng(0)), start=1):
        best, value = best_of_all(sample, count)
        every = [objective(sample, beams) for beams in combinations(range(7), count)]
        assert value == pytest.approx(min(every))
        assert objective(sample, best) == pytest.approx(value)
        assert objective(sample, greedy) >= value - 1e-4


@pytest.mark.slow(kept=("24",))
@pytest.mark.parametrize("beams", [24, 8])
def test_a_looser_loss_takes_no_more_beams(beams: int) -> None:
    full = scanner(beams)
    sample, check = samples(full, places=60)
    counts = []
    for limit in (1.0, 3.0, 8.0, 20.0, 60.0):
        found = choose(full, [sample], [check], limit, np.random.default_rng(3))
        counts.append(len(found.chosen.beams))
        assert found.chosen.within(limit)
        assert found.chosen.checked == check.loss(found.chosen.beams)
        assert dict(found.each)[check.name] == found.chosen.checked
        assert len(found.gaps) == (0 if beams > 12 else len(found.curves["greedy"]))
        assert all(gap.greedy_points >= gap.exact_points - 1.1e-3 for gap in found.gaps)
    assert counts == sorted(counts, reverse=True)
    assert counts[0] > counts[-1]


@pytest.mark.slow
def test_where_no_beam_can_go_all_are_kept() -> None:
    full = scanner(5)
    sample, check = samples(full, places=60)
    for limit in (1e-3, 1e-12):
        found = choose(full, [sample], [check], limit, np.random.default_rng(3))
        assert (found.method, found.chosen.beams) == ("all", (0, 1, 2, 3, 4))
    assert scan_masks(full, found.chosen.beams) == ()


@pytest.mark.parametrize("limit", [0.0, -1.0, 100.0, math.nan, math.inf])
def test_a_loss_out_of_range_is_refused(limit: float) -> None:
    with pytest.raises(an.InputError, match="percentage points above 0 and below 100"):
        choose(scanner(5), [], [], limit, np.random.default_rng(3))


def test_a_single_beam_cannot_be_left_out() -> None:
    with pytest.raises(an.InputError, match="a single beam"):
        choose(scanner(1), [], [], 5.0, np.random.default_rng(3))


def test_even_beams_are_even() -> None:
    assert even(scanner(360), 4) == (0, 90, 180, 270)
    assert even(scanner(360), 90) == tuple(range(0, 360, 4))
    assert even(scanner(181, math.pi), 3) == (0, 90, 180)
    assert even(scanner(181, math.pi), 1) == (90,)
    for beams in (11, 24):
        for count in range(2, beams + 1):
            around, fan = even(scanner(beams), count), even(scanner(beams, 2.0), count)
            assert (around[0], fan[0], fan[-1]) == (0, 0, beams - 1)
            gaps = np.diff([*around, beams]), np.diff(fan)
            assert [len(gap) for gap in gaps] == [count, count - 1]
            assert all(gap.min() >= 1 and gap.max() - gap.min() <= 1 for gap in gaps)
    assert len(set(at_random(scanner(24), 9, np.random.default_rng(1)))) == 9


def test_a_written_subset_scans_as_the_full_scanner_does() -> None:
    env = scenes.scene(2, size=6.0, blocks=4, thin=2)
    full = an.RangeScanner(
        (Part(SENSOR, Planar(36, math.tau, (0.1, 0.0, 0.3))), Part(CONE, Ring(6, 0.1)),
         Part(SENSOR, Mounts(((0.0, 0.1, 1.0), (0.0, -0.1, -1.0))))),
        "three parts", robot_radius=0.2,
    )  # fmt: skip
    x, y = scenes.points_inside(env, 20, 3, margin=0.3).T
    kept = [0, 3, 5, 35, 36, 37, 38, 39, 40, 41, 43]
    back = an.RangeScanner.from_yaml_text(subset_scanner(full, kept).to_yaml())
    np.testing.assert_allclose(
        back.scan(env, x, y, 0.7), full.scan(env, x, y, 0.7)[:, kept], atol=1e-5
    )
    assert back.parts[1] == full.parts[1]
    assert back.name == "three parts (11 of 44 beams)"
    assert back.robot_radius == 0.2
    assert subset_scanner(full, range(44)) is full
    for bad in ([], [0, 0], [44], [-1]):
        with pytest.raises(an.InputError, match="give one or more of 0 to 43"):
            subset_scanner(full, bad)


@pytest.mark.parametrize("angle_min", [None, 0.0, -90.0])
def test_masked_messages_hold_the_readings_of_the_kept_beams(angle_min: float | None) -> None:
    full = scanner(36)
    kept = (0, 1, 9, 30)
    (mask,) = scan_masks(full, kept, ["scan_link"], angle_min)
    assert (mask.frame, mask.readings) == ("scan_link", 36)
    assert mask.first == (-180.0 if angle_min is None else angle_min)
    left = sorted(set(range(36)) - set(mask.masked))
    # Directions of the readings of a message that begins at angle_min.
    angles = np.sort((np.array(left) * 10.0 + mask.first) % 360.0)
    np.testing.assert_allclose(angles, np.sort(np.degrees(full.mounts[list(kept), 2]) % 360.0))


def test_filters_name_each_laser_and_no_sonar() -> None:
    full = an.RangeScanner.mixed(
        scanner(10), an.RangeScanner.ring(CONE, 4, 0.1), scanner(5, 1.0), scanner(3, 1.0)
    )
    masks = scan_masks(full, [0, 9, 11, 14, *range(19, 22)])
    assert [(m.frame, m.readings, m.masked) for m in masks] == [
        ("laser", 10, (1, 2, 3, 4, 5, 6, 7, 8)), ("laser2", 5, (1, 2, 3, 4)), ("laser3", 3, ()),
    ]  # fmt: skip
    plain = yaml.safe_load(laser_filters_text(masks))
    one = plain["scan_to_scan_filter_chain"]["ros__parameters"]["filter1"]
    assert one["type"] == "laser_filters/LaserScanMaskFilter"
    # The filter declares arrays of doubles; a whole number would be an array of integers.
    assert one["params"]["masks"]["laser2"] == [1.0, 2.0, 3.0, 4.0]
    assert all(isinstance(index, float) for index in one["params"]["masks"]["laser"])
    assert "laser3" not in one["params"]["masks"]
    assert scan_masks(an.RangeScanner.ring(CONE, 4, 0.1), [0]) == ()
