"""Intensities in the ambiguity map: a reflector fixes what ranges leave open, and nothing else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
import pytest
import shapely

import ambinav as an
from ambinav.ambiguity.beam_table import BeamTable
from ambinav.ambiguity.heading import turns
from ambinav.ambiguity.returns import BLIND, beam_returns
from ambinav.geometry.environment import Environment
from ambinav.geometry.obstacle import Obstacle
from ambinav.geometry.segments import FRONTIER, REFLECTOR, WALL, Segments
from ambinav.layers.aliasing.layer import aliased_poses
from ambinav.layers.build import with_layers
from ambinav.layers.context import LayerContext
from ambinav.sensing import Intensity, RangeScanner, RangeSensor
from tests.ambiguity.test_reference import COARSE, MIXED, OFF_CENTRE, worst
from tests.geometry import scenes

# Compiles kernels that no other test needs.
pytestmark = pytest.mark.slow

CHANNEL = Intensity(wall=0.3, reflector=1.0, std=0.15)
RANGE = 3.0
LASER = RangeScanner.planar(
    RangeSensor(max_range=RANGE, std=0.02, resolution=0.01), 60, 2 * math.pi
)
SEEING = LASER.with_intensity(CHANNEL)
LENGTH, WIDTH, MIDDLE = 16.0, 2.0, 8.0
CORE = ("ambiguity", "major", "minor", "level", "major_radius", "zone", "direction")


def corridor(tag: float | None) -> Environment:
    """A long corridor, with a tag of this width flat on the middle of one wall; None: bare."""
    tags = [] if tag is None else [[(MIDDLE - tag / 2, 0.0), (MIDDLE + tag / 2, 0.0)]]
    return an.environment_from_shapes([shapely.box(0, 0, LENGTH, WIDTH)], reflectors=tags)


def built(env: Environment, scanner: RangeScanner) -> an.AmbiguityMap:
    """A coarse map, computed."""
    return an.build_map(env, scanner, spacing=0.2, store=False)


def along(amap: an.AmbiguityMap, name: str, x: float) -> float:
    """A layer in the middle of the corridor."""
    return float(amap.sample(name, x, WIDTH / 2))


@pytest.fixture(scope="module")
def bare() -> an.AmbiguityMap:
    return built(corridor(None), SEEING)


@pytest.fixture(scope="module")
def unheard() -> an.AmbiguityMap:
    return built(corridor(0.4), LASER)


@pytest.fixture(scope="module")
def tagged() -> an.AmbiguityMap:
    return built(corridor(0.4), SEEING)


def mirrored(env: Environment) -> Environment:
    """The same with every fourth segment a reflector and every fifth a frontier."""
    number = np.arange(len(env.segments))
    kind = np.where(number % 4 == 0, REFLECTOR, np.where(number % 5 == 0, FRONTIER, WALL))
    return Environment(Segments(env.segments.xy, kind.astype(np.uint8)), env.free, resolution=0.05)


@pytest.mark.parametrize("scanner", [COARSE, MIXED, OFF_CENTRE], ids=["coarse", "mixed", "off"])
def test_the_kernel_agrees_with_the_reference(scanner: RangeScanner) -> None:
    """For lasers beside sonars, off the centre, with coarse bins, and where angles matter."""
    env = mirrored(scenes.scene(5, size=6.0, blocks=7, thin=6).transformed(0.1234))
    seeing = scanner.with_intensity(replace(CHANNEL, min_range=0.6))
    headings = None if scanner.looks_all_around else 2
    # Coarse bins take the reference long.
    poses = 1 if scanner is COARSE else 2
    assert worst(env, seeing, headings=headings, poses=poses) < 1e-4
    table = BeamTable.of(seeing, 0.03, 0.05, reflectors=True)
    assert 0 < len(table.intensity) == len(seeing.intensity_beams) <= table.beams


def test_lasers_that_need_steep_surfaces() -> None:
    """An echo too oblique to return has no intensity either."""
    sensor = RangeSensor(
        max_range=4.0, std=0.01, resolution=0.01, max_incidence=1.0, intensity=CHANNEL
    )
    env = mirrored(scenes.scene(5, size=6.0, blocks=7, thin=6).transformed(0.1234))
    assert worst(env, RangeScanner.planar(sensor, 24, 2 * math.pi), poses=2) < 1e-4


def test_without_channel_or_reflectors_nothing_changes(
    bare: an.AmbiguityMap, unheard: an.AmbiguityMap
) -> None:
    """To the bit: a channel in a building without reflectors, reflectors without a channel."""
    plain = built(corridor(None), LASER)
    env = corridor(0.4)
    walls = np.zeros_like(env.segments.kind)
    unmarked = built(Environment(Segments(env.segments.xy, walls), env.free), LASER)
    for name in CORE:
        values = [m.dataset[name].values for m in (plain, bare, unmarked, unheard)]
        assert np.array_equal(values[0], values[1], equal_nan=True), name
        assert np.array_equal(values[2], values[3], equal_nan=True), name
        # And a tag flat on the wall is none for the ranges.
        if name != "direction":
            assert np.allclose(values[0], values[2], atol=1e-5, equal_nan=True), name


def test_a_tag_fixes_the_position_along_a_corridor(
    bare: an.AmbiguityMap, tagged: an.AmbiguityMap
) -> None:
    """Near it, alike on both sides; out of its sight nothing changes."""
    assert along(bare, "major", MIDDLE) > 0.8
    for off in (-0.5, 0.0, 0.5):
        assert along(tagged, "major", MIDDLE + off) < 0.65
        assert along(tagged, "zone", MIDDLE + off) < along(bare, "zone", MIDDLE + off)
    assert along(tagged, "minor", MIDDLE) <= along(bare, "minor", MIDDLE) + 1e-3
    for off in (0.3, 0.7, 1.5, 2.5):
        left, right = along(tagged, "level", MIDDLE - off), along(tagged, "level", MIDDLE + off)
        # Beams of a full circle are mirrored with the corridor.
        assert math.isclose(left, right, abs_tol=1e-3)
    x = bare.dataset["x"].values
    far = np.abs(x - MIDDLE) > RANGE + 0.5 + 0.5
    assert far.sum() > 20
    for name in ("ambiguity", "major", "minor"):
        values = [m.dataset[name].values[:, far] for m in (tagged, bare)]
        assert np.allclose(*values, atol=1e-5, equal_nan=True)


def test_a_tag_weighs_the_same_however_many_beams_meet_it(tagged: an.AmbiguityMap) -> None:
    """Thinning takes nothing from it: `tau` grows with the beams."""
    sensor = SEEING.sensors[0]
    fine = RangeScanner.planar(sensor, 720, 2 * math.pi)
    places = [MIDDLE + off for off in (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)]
    levels = [along(tagged, "major", x) for x in places]
    assert levels[0] < 0.53 and 0.94 < levels[4] < 0.97
    for beams in (60, 240, 720):
        amap = an.build_map(corridor(0.4), fine, spacing=0.2, store=False, max_beams=beams)
        assert np.allclose(levels, [along(amap, "major", x) for x in places], atol=0.04)


def test_a_noisy_channel_tells_nothing(unheard: an.AmbiguityMap) -> None:
    """The limit of a large deviation is the map without the channel."""
    noisy = built(corridor(0.4), LASER.with_intensity(replace(CHANNEL, std=1e3)))
    for name in ("ambiguity", "major", "minor"):
        values = [m.dataset[name].values for m in (noisy, unheard)]
        assert np.allclose(*values, atol=1e-5, equal_nan=True)


def test_what_the_columns_hold() -> None:
    """Means, variances, and nothing where there is no echo or it is too near."""
    env = corridor(0.4)
    channel = replace(CHANNEL, min_range=1.2)
    scanner = RangeScanner.planar(
        RangeSensor(max_range=RANGE, std=0.02, resolution=0.01, intensity=channel), 4, 2 * math.pi
    )
    table = BeamTable.of(scanner, 0.03, 0.05, reflectors=True)
    data = np.zeros((1, 5, len(table.limit)), dtype=np.float32)
    data[:, 4] = 1.0
    # Beams look back, down, ahead and up; the tag is below, the upper wall too near.
    beam_returns(env, scanner, table, np.array([MIDDLE]), np.array([1.5]), 0.0, data)
    read = data[0, :, 4:8]
    assert np.allclose(read[0], [0.3, 1.0, 0.3, 0.3])
    assert (read[1:4] == 0.0).all()
    assert np.allclose(read[4], [BLIND, 0.15**2 / 2, BLIND, BLIND])
    assert (table.limit[4:8] > 1.0).all()
    assert np.allclose(table.inverse_cap[4:8], table.inverse_cap[:4])
    assert table.use.sum() == 8
    # The intensity of a beam goes with the beam.
    around = table.turned(turns(scanner))
    assert around.shape == (4, 8)
    assert (around[:, 4:] == around[:, :4] + 4).all()
    assert (np.sort(around, axis=1) == np.arange(8)).all()


def test_unknown_space_is_counted_by_ranges() -> None:
    """Beams without an echo have no intensity, but end in no unknown space."""
    amap = built(corridor(0.4), SEEING)
    assert float(np.nanmax(amap.dataset["unknown"].values)) == 0.0


def test_aliasing_tells_twin_rooms_apart() -> None:
    """Two rooms that are alike but for a tag: their poses are each other's twins no more."""
    room = shapely.Polygon([(0, 0), (3, 0), (3.5, 1.2), (1.2, 2.6)])
    twin = shapely.affinity.translate(room, 10, 0)
    env = an.environment_from_shapes([room, twin], reflectors=[[(1.0, 0.0), (1.8, 0.0)]])
    share = {}
    for name, scanner in (("ranges", LASER), ("both", SEEING)):
        context = LayerContext.of(built(env, scanner), env)
        share[name] = aliased_poses(context, least=0.01)
    assert np.nanmedian(share["ranges"].share) > 0.45
    assert np.nanmedian(share["both"].share) < 0.2
    best = share["both"].poses[:, 0, 0, 3]
    assert np.nanmedian(share["ranges"].poses[:, 0, 0, 3]) > 0.99
    assert np.isnan(best).mean() + (best < 0.3).mean() > 0.5
    layers = ("aliasing", "coastal_entropy", "fisher")
    both, ranges = (
        with_layers(built(env, scanner), layers, environment=env).dataset
        for scanner in (SEEING, LASER)
    )
    # Settled by casting, as the search itself.
    assert np.nanmedian(both["aliasing"].values) < 0.2 < np.nanmedian(ranges["aliasing"].values)
    # What has no derivative is no part of Fisher's information.
    assert np.array_equal(both["fisher"].values, ranges["fisher"].values, equal_nan=True)
    gain = [np.nanmean(d["coastal_entropy_gain"].values) for d in (both, ranges)]
    assert gain[0] >= gain[1] - 1e-6


def test_a_tag_that_is_put_up_updates_the_map(bare: an.AmbiguityMap) -> None:
    """A building edited is the building drawn, and its map updated is its map computed."""
    env = corridor(None).edited(
        add=[Obstacle.panel(MIDDLE - 0.2, 0.0, MIDDLE + 0.2, 0.0, reflective=True)]
    )
    drawn = corridor(0.4)
    assert env.segments.lengths[env.segments.reflectors].sum() == pytest.approx(0.4)
    assert env.segments.lengths.sum() == pytest.approx(drawn.segments.lengths.sum())
    updated, whole = bare.update(env), built(drawn, SEEING)
    for name in ("ambiguity", "major", "minor", "level", "heading"):
        values = [m.dataset[name].values for m in (updated, whole)]
        assert np.allclose(*values, atol=1e-5, equal_nan=True), name


@pytest.mark.parametrize("reflectors", [True, False])
@pytest.mark.parametrize("beams", [range(12), (3,), (1, 4, 8, 9, 11), (9, 2, 10, 0)])
def test_the_table_of_some_beams_is_that_of_a_scanner_which_has_these_alone(
    beams: Sequence[int], reflectors: bool
) -> None:
    """Beams of three sensors, one of which reads intensities; in any order."""
    sensors = (
        RangeSensor(max_range=4.0, std=0.03, resolution=0.01),
        RangeSensor(max_range=3.0, std=0.02, resolution=0.05, intensity=CHANNEL),
        RangeSensor(max_range=2.0, std=0.05, resolution=0.02, min_range=0.2),
    )
    sensor = np.tile([0, 1, 2, 1], 3)
    mounts = np.column_stack([np.zeros((12, 2)), np.arange(12) / 2.0])
    full = BeamTable.of(RangeScanner.from_mounts(sensors, mounts, sensor), 0.03, 0.05, reflectors)
    kept = np.array(beams)
    alone = RangeScanner.from_mounts(sensors, mounts[kept], sensor[kept])
    expected, found = BeamTable.of(alone, 0.03, 0.05, reflectors), full.subset(beams)
    for field in fields(BeamTable):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(expected, field.name))
    columns = full.columns_of(beams)
    assert columns[: len(kept)].tolist() == list(beams)
    assert full.intensity[columns[len(kept) :] - full.beams].tolist() == [
        beam for beam in beams if reflectors and sensor[beam] == 1
    ]
