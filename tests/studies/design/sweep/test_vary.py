"""Variations: how they are written, and the scanners that they stand for."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import ambinav as an
from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Part
from ambinav.sensing.space_layout import Camera
from ambinav.sensing.tilting_layout import Tilting
from ambinav.studies.design.sweep.vary import Variation, part_number, present_values, settings

LASER = an.RangeSensor(name="laser", max_range=4.0, std=0.03, resolution=0.001)
SONAR = an.RangeSensor(
    name="sonar", max_range=3.0, std=0.05, resolution=0.01, aperture=math.radians(20)
)
FAN = an.RangeScanner.planar(LASER, 31, math.pi, (0.1, 0.0, 0.0), name="fan")
RING = an.RangeScanner.ring(SONAR, 16, 0.2, name="ring")
MIXED = an.RangeScanner.mixed(FAN, RING, name="rig")


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("aperture=60:360:100", (60, 160, 260, 360)),
        ("aperture=60:355:100", (60, 160, 260, 355)),
        ("yaw=0:360:90", (0, 90, 180, 270)),
        ("yaw = 350, -10, 20", (350, 20)),
        ("beams=4:7", (4, 5, 6, 7)),
        ("beams=4:9:2", (4, 6, 8, 9)),
        ("max_range=0.3:0.5:0.1", (0.3, 0.4, 0.5)),
        ("std=0.01", (0.01,)),
        ("resolution=1e-3:1e-3:1", (1e-3,)),
    ],
)
def test_values_are_read(text: str, values: tuple[float, ...]) -> None:
    assert Variation.parse(text).values == pytest.approx(values)


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("aperture", "names no values"),
        ("aperture=", "names no values"),
        ("apertur=60", "is not a property of a scanner; did you mean aperture"),
        ("aperture=60:360", "is not a range; give aperture=first:last:step"),
        ("aperture=1:2:3:4", "is not a range"),
        ("aperture=360:60:30", "runs backwards; give aperture=60:360:30"),
        ("beams=9:4", "runs backwards"),
        ("aperture=60:360:0", "has a step of 0"),
        ("aperture=60:360:-30", "has a step of -30"),
        ("aperture=60:wide:30", "'wide' in 'aperture=60:wide:30' is not a number"),
        ("aperture=60,,90", "is not a number"),
        ("aperture=0:90:30", "0 degrees is not an aperture"),
        ("aperture=400", "400 degrees is not an aperture"),
        ("beams=2.5", "2.5 is not a number of beams"),
        ("beams=0:4", "0 is not a number of beams"),
        ("yaw=nan", "is not finite"),
        ("height=-0.1:0.3:0.2", "vary height: -0.1 m is not above the floor; give metres above 0"),
        ("yaw=0:inf:5", "not finite"),
        ("std=0:1:1e-9", "1000000001 settings"),
    ],
)
def test_what_cannot_be_read_is_refused(text: str, what: str) -> None:
    with pytest.raises(InputError, match=what):
        Variation.parse(text)


def scanners(
    scanner: an.RangeScanner, *texts: str, part: str | None = None
) -> list[an.RangeScanner]:
    found = settings(scanner, [Variation.parse(text) for text in texts], part)
    return [one.scanner for one in found]


def test_an_aperture_keeps_the_angle_between_beams() -> None:
    narrow, wide, round_about = scanners(FAN, "aperture=60,240,360")
    assert (narrow.beams, wide.beams, round_about.beams) == (11, 41, 60)
    assert narrow.aperture == pytest.approx(math.radians(60))
    assert round_about.parts[0].layout.mounts()[:, 0] == pytest.approx(0.1)
    beams = [one.beams for one in scanners(FAN, "aperture=60,360", "beams=8,9")]
    assert beams == [8, 9, 8, 9]


def test_a_mounted_scanner_turns_at_its_mount() -> None:
    (turned,) = scanners(FAN, "yaw=90")
    np.testing.assert_allclose(turned.mounts[:, :2], FAN.mounts[:, :2])
    np.testing.assert_allclose(turned.mounts[:, 2], FAN.mounts[:, 2] + math.pi / 2)


def test_a_ring_turns_about_the_robot() -> None:
    (turned,) = scanners(RING, "yaw=90")
    np.testing.assert_allclose(turned.mounts[0, :2], [0.0, 0.2], atol=1e-12)
    (fewer,) = scanners(RING, "beams=8")
    assert fewer.beams == 8


def test_beams_listed_one_by_one_turn_where_they_sit_at_one_point() -> None:
    listed = an.RangeScanner.from_mounts(LASER, [[0.1, 0, 0], [0.1, 0, 0.5]])
    (turned,) = scanners(listed, "yaw=90")
    np.testing.assert_allclose(turned.mounts[:, 2], [math.pi / 2, 0.5 + math.pi / 2])
    apart = an.RangeScanner.from_mounts(LASER, [[0.1, 0, 0], [0.2, 0, 0.5]])
    with pytest.raises(InputError, match="has no yaw: its sensors are mounted at several points"):
        scanners(apart, "yaw=90")
    with pytest.raises(InputError, match="has no beams: its sensors are listed individually"):
        scanners(listed, "beams=1")


def test_sensors_are_varied() -> None:
    (one,) = scanners(FAN, "max_range=2.5", "std=0.1", "resolution=0.05")
    sensor = one.sensors[0]
    assert (sensor.max_range, sensor.std, sensor.resolution) == (2.5, 0.1, 0.05)
    with pytest.raises(InputError, match="vary max_range -1: sensor 'laser': "):
        scanners(FAN, "max_range=-1")


def test_one_part_of_a_rig_is_varied() -> None:
    for name in ("sonar", "Sonar", "2"):
        (one,) = scanners(MIXED, "max_range=2", part=name)
        assert [part.sensor.max_range for part in one.parts] == [4.0, 2.0]
    with pytest.raises(InputError, match=r"has 2 parts; name the one to vary: 1 \(laser\), 2 "):
        scanners(MIXED, "max_range=2")
    with pytest.raises(InputError, match="has no part 'radar'"):
        part_number(MIXED, "radar")
    twice = an.RangeScanner.mixed(FAN, FAN)
    with pytest.raises(InputError, match="has several parts 'laser'"):
        part_number(twice, "laser")


def test_a_ring_has_no_aperture() -> None:
    with pytest.raises(InputError, match="scanner 'ring' has no aperture"):
        scanners(RING, "aperture=90")


LAYERS = an.RangeScanner.layered(LASER, 36, [-0.2, 0.1], z=0.5, pitch=0.1, name="layers")
TILTING = an.RangeScanner((Part(LASER, Tilting(31, math.pi, (-0.2, 0.0, 0.2), z=0.5)),))
CAMERA = an.RangeScanner((Part(LASER, Camera(4, 3, 1.0, 0.8, z=0.5)),))
LISTED = an.RangeScanner.from_mounts(LASER, [[0.1, 0, 0], [0.2, 0, 1]])


@pytest.mark.parametrize("scanner", [FAN, RING, LAYERS, TILTING, CAMERA, LISTED])
def test_a_scanner_is_raised_to_a_height(scanner: an.RangeScanner) -> None:
    vary = [Variation.parse("height=0.8")]
    (high,) = scanners(scanner, "height=0.8")
    np.testing.assert_allclose(high.upright[:, 0], 0.8)
    np.testing.assert_array_equal(high.upright[:, 1], scanner.upright[:, 1])
    np.testing.assert_array_equal(high.mounts, scanner.mounts)
    assert present_values(high, vary) == pytest.approx((0.8,))
    assert present_values(scanner, vary) == pytest.approx((scanner.upright[0, 0],))
    assert "height 0.8 m instead of" in high.description


def test_a_tilted_mount_looks_down() -> None:
    (fan,) = scanners(FAN, "pitch=20")
    assert fan.upright[15, 1] == pytest.approx(math.radians(-20))
    # To the sides it stays level.
    assert fan.upright[[0, -1], 1] == pytest.approx([0.0, 0.0])
    (layers,) = scanners(LAYERS, "pitch=0", "yaw=30")
    assert layers.upright[:36, 1] == pytest.approx(-0.2)
    assert "yaw 30 degrees instead of 0 degrees" in layers.description
    assert "pitch 0 degrees instead of 5.72958 degrees" in layers.description
    (camera,) = scanners(CAMERA, "pitch=90")
    assert camera.upright[:, 1].mean() < -1.0
    for scanner in (RING, TILTING, LISTED):
        with pytest.raises(InputError, match=r"has no pitch: it tilts by itself, or its sensors"):
            scanners(scanner, "pitch=5")
    with pytest.raises(InputError, match="vary pitch 91: pitch is 91 degrees; give -90 to 90"):
        scanners(FAN, "pitch=91")


def test_an_aperture_keeps_the_angle_between_columns() -> None:
    narrow, around = scanners(LAYERS, "aperture=90,360")
    assert (narrow.beams, around.beams) == (2 * 10, 2 * 36)
    assert narrow.parts[0].layout == replace(
        LAYERS.parts[0].layout, columns=10, aperture=math.pi / 2
    )
    (narrow,) = scanners(TILTING, "aperture=60")
    assert narrow.beams == 3 * 11
    mid = an.RangeScanner.from_preset("livox-mid-360")
    (narrow,) = scanners(mid, "aperture=90")
    assert narrow.beams == pytest.approx(mid.beams / 4, rel=0.02)
    with pytest.raises(InputError, match="has no aperture: it is a camera, or"):
        scanners(CAMERA, "aperture=90")
    with pytest.raises(InputError, match=r"has no beams: .*, or it is a 3D scanner"):
        scanners(LAYERS, "beams=9")


def test_what_sits_at_several_heights_has_none() -> None:
    with pytest.raises(InputError, match="has no height: its sensors are mounted at several"):
        listed = an.RangeScanner.from_mounts(
            LASER, [[0, 0, 0], [0, 0, 1]], upright=[[0.2, 0], [0.5, 0]]
        )
        scanners(listed, "height=0.5")
    low, high = scanners(MIXED, "height=0.4,0.8", part="sonar")
    assert set(low.upright[:, 0].round(9)) == {0.0, 0.4}
    assert set(high.upright[:, 0].round(9)) == {0.0, 0.8}


def test_a_variable_is_varied_once() -> None:
    with pytest.raises(InputError, match="yaw is varied twice"):
        scanners(FAN, "yaw=0", "yaw=90")
    with pytest.raises(InputError, match="nothing is varied"):
        scanners(FAN)


def test_a_grid_has_an_end() -> None:
    with pytest.raises(InputError, match="that makes 8640 settings"):
        scanners(FAN, "yaw=0:359:1", "beams=4:27")


def test_a_single_beam_has_no_angle_to_keep() -> None:
    with pytest.raises(InputError, match="a single beam"):
        scanners(an.RangeScanner.planar(LASER, 1, 0.0), "aperture=90")


def test_present_values() -> None:
    variations = [Variation.parse(text) for text in ("aperture=60", "yaw=1", "beams=4", "std=1")]
    assert present_values(FAN, variations) == pytest.approx((180, 0, 31, 0.03))
    curved = an.RangeScanner.from_preset("hokuyo-urg-04lx")
    assert math.isnan(present_values(curved, [Variation.parse("std=0.1")])[0])


def test_a_changed_scanner_says_what_was_changed_of_which() -> None:
    urg = an.RangeScanner.from_preset("hokuyo-urg-04lx")
    (one,) = settings(urg, [Variation("aperture", (60.0,)), Variation("std", (0.02,))])
    assert one.scanner.description == (
        f"hokuyo-urg-04lx ({urg.description}), but aperture 60 degrees instead of 239.414 degrees, "
        "beams 172 instead of 682, standard deviation 0.02 m instead of the curve over the range"
    )
    assert an.RangeScanner.from_yaml_text(one.scanner.to_yaml()) == one.scanner
    # Turned by a whole turn it is what it was, with its name.
    (same,) = settings(urg, [Variation("yaw", (360.0,))])
    assert same.scanner is urg
    sonars = an.RangeScanner.mixed(urg, an.RangeScanner.from_preset("polaroid-6500-ring"))
    (ring,) = settings(sonars, [Variation("yaw", (15.0,))], "2")
    assert "of part 2" in ring.scanner.description
    assert "yaw 15 degrees instead of 0 degrees" in ring.scanner.description


@pytest.mark.parametrize(
    ("vary", "scanner"),
    [
        ("beams=1e12", an.RangeScanner.from_preset("rplidar-a1")),
        ("height=0.5 beams=1e12", an.RangeScanner.from_preset("rplidar-a1")),
        ("beams=200000", an.RangeScanner.from_preset("polaroid-6500-ring")),
        # 2 beams a nanoradian apart, all around.
        (
            "aperture=360",
            an.RangeScanner.planar(
                an.RangeSensor(max_range=4.0, std=0.03, resolution=0.01), 2, 1e-9
            ),
        ),
    ],
)
def test_a_scanner_of_too_many_beams_is_refused(vary: str, scanner: an.RangeScanner) -> None:
    with pytest.raises(InputError, match="beams; give at most 100000"):
        settings(scanner, [Variation.parse(text) for text in vary.split()])
