"""Scanners that look up and down: their beams, their files, and what thinning keeps of them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
from scipy.spatial.transform import Rotation

from ambinav.buildings.shapes import environment_from_shapes
from ambinav.geometry.extrude import extruded
from ambinav.runtime.errors import InputError
from ambinav.sensing import PRESETS, RangeScanner, RangeSensor, preset_names
from ambinav.sensing.layout import Mounts, Part, Planar
from ambinav.sensing.rays import cone_offsets
from ambinav.sensing.space_layout import Camera, Layers
from ambinav.sensing.tilting_layout import Tilting

LASER = RangeSensor(max_range=4.0, std=0.03, resolution=0.001)
SONAR = RangeSensor(max_range=4.0, std=0.03, resolution=0.01, aperture=math.radians(30))
IN_SPACE = {
    *("livox-mid-360", "ouster-os1-32", "realsense-d435", "service-robot", "velodyne-vlp-16")
}


def directions(scanner: RangeScanner) -> np.ndarray:
    """Unit vectors of the beams, shape (B, 3)."""
    azimuth, elevation = scanner.mounts[:, 2], scanner.upright[:, 1]
    flat = np.cos(elevation)
    return np.column_stack([flat * np.cos(azimuth), flat * np.sin(azimuth), np.sin(elevation)])


# -- what nothing may change -------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(set(preset_names()) - IN_SPACE))
def test_scanners_in_the_plane_keep_every_bit(name: str) -> None:
    """Their rays are what the 2D documents say: mounts and offsets in the cone, nothing added."""
    scanner = RangeScanner.from_preset(name)
    rays, ends = scanner.rays(), []
    for mount, sensor in zip(scanner.mounts, scanner.sensor_of_beam, strict=True):
        offsets = cone_offsets(scanner.sensors[sensor].aperture)
        ends += [(mount[0], mount[1], mount[2] + offset) for offset in offsets]
    assert (np.column_stack([rays.origin, rays.angle]) == np.array(ends)).all()
    assert not rays.height.any() and not rays.elevation.any()
    assert scanner.level and scanner.vertical_aperture == 0.0
    assert not any(key in scanner.to_yaml() for key in ("pitch", "roll", "elevation", "z:"))


# -- where beams point -------------------------------------------------------------------------


@pytest.mark.parametrize("layout", [
    Planar(7, math.radians(200), (0.1, 0.2, 0.4), 0.5, 0.3, -0.2),
    Layers(5, math.radians(100), (-0.2, 0.0, 0.3), False, (0.1, 0.2, 2.0), 0.5, -0.4, 0.7),
    Camera(4, 3, math.radians(87), math.radians(58), (0.1, 0.2, -1.0), 0.5, 0.5, 0.1),
])  # fmt: skip
def test_tilted_beams_are_turned_as_ros_turns_them(layout: Planar | Layers | Camera) -> None:
    """Against SciPy: roll about x first, then pitch about y, then yaw about z."""
    from dataclasses import replace

    level = replace(layout, mount=(0.0, 0.0, 0.0), z=0.0, pitch=0.0, roll=0.0)
    turn = Rotation.from_euler("xyz", [layout.roll, layout.pitch, layout.mount[2]])
    own = directions(RangeScanner((Part(LASER, level),)))
    scanner = RangeScanner((Part(LASER, layout),))
    assert directions(scanner) == pytest.approx(turn.apply(own), abs=1e-12)
    assert (scanner.mounts[:, :2] == [0.1, 0.2]).all() and (scanner.upright[:, 0] == 0.5).all()


@pytest.mark.parametrize("degrees", [180, -180, 360])
def test_a_laser_upside_down_is_level(degrees: int) -> None:
    """It scans a plan, with its beams in the other order."""
    sensor = "{max_range: 5, std: 0.02, resolution: 0.01}"
    text = "parts:\n  - sensor: {}\n    planar: {{beams: 9, aperture_deg: 200, roll_deg: {}}}\n"
    scanner = RangeScanner.from_yaml_text(text.format(sensor, degrees))
    upright = RangeScanner.from_yaml_text(text.format(sensor, 0))
    assert scanner.level
    order = -1 if degrees % 360 else 1
    assert scanner.mounts[::order] == pytest.approx(upright.mounts, abs=1e-12)


def test_keys_without_a_value_are_not_given() -> None:
    text = "robot_radius: null\nparts:\n  - sensor: {}\n    planar: {}\n    intensity: null\n"
    sensor = "{max_range: 5, std: 0.02, resolution: 0.01, intensity: null}"
    planar = "{beams: 9, aperture_deg: 200}"
    scanner = RangeScanner.from_yaml_text(text.format(sensor, planar))
    assert scanner.robot_radius is None and not len(scanner.intensity_beams)
    cone = sensor.replace("intensity: null", "aperture_deg: 30")
    bad = text.replace("intensity: null", "intensity: {{wall: 0.3, reflector: 1, std: 0.1}}")
    with pytest.raises(InputError, match=r"parts\[0\].*intensity is given with an aperture"):
        RangeScanner.from_yaml_text(bad.format(cone, planar))


def test_pitch_looks_down() -> None:
    ahead = RangeScanner.planar(LASER, 1, 0.0, pitch=0.2)
    assert ahead.upright[0].tolist() == pytest.approx([0.0, -0.2])


TILTING = Tilting(9, math.radians(200), (-0.5, 0.0, 0.7), (0.1, 0.2, 0.4), 0.5)


def test_a_tilting_laser_is_a_fan_at_each_pitch() -> None:
    scanner = RangeScanner((Part(LASER, TILTING),))
    fans = [
        RangeScanner.planar(LASER, 9, math.radians(200), (0.1, 0.2, 0.4), z=0.5, pitch=pitch)
        for pitch in TILTING.pitch
    ]
    assert (scanner.mounts == np.concatenate([fan.mounts for fan in fans])).all()
    assert (scanner.upright == np.concatenate([fan.upright for fan in fans])).all()
    assert scanner.vertical_aperture == pytest.approx(1.2)
    again = RangeScanner.from_yaml_text(scanner.to_yaml())
    assert isinstance(again.parts[0].layout, Tilting)
    assert directions(again) == pytest.approx(directions(scanner), abs=1e-12)
    assert TILTING.moved(1.0, 2.0, 3.0).mount == (1.1, 2.2, 0.4)
    assert scanner.raised(0.2).upright[:, 0].tolist() == pytest.approx([0.7] * 27)


def test_a_tilting_laser_in_a_room_has_the_ranges_of_trigonometry() -> None:
    """From the middle of 8 x 8 x 3 m, 1 m high: floor, wall and ceiling ahead."""
    room = environment_from_shapes([shapely.box(0, 0, 8, 8)])
    room = room.in_space(extruded(room, 3.0))
    pitch = tuple(math.radians(angle) for angle in (30.0, 10.0, 0.0, -20.0, -40.0))
    far = RangeSensor(max_range=20.0, std=0.03, resolution=0.001)
    scanner = RangeScanner((Part(far, Tilting(3, math.pi, pitch, z=1.0)),))
    ranges = scanner.scan(room, 4.0, 4.0, 0.0).reshape(5, 3)
    ahead = [
        1.0 / math.sin(pitch[0]), 4.0 / math.cos(pitch[1]), 4.0, 4.0 / math.cos(pitch[3]),
        2.0 / math.sin(-pitch[4]),
    ]  # fmt: skip
    assert ranges[:, 1] == pytest.approx(ahead, abs=1e-5)
    assert ranges[:, [0, 2]] == pytest.approx(np.full((5, 2), 4.0), abs=1e-5)


def test_thinning_keeps_the_lowest_and_the_highest_fan() -> None:
    whole = Tilting(181, math.pi, tuple(np.linspace(-0.5, 0.5, 31).tolist()))
    thin = whole.thinned(200)
    assert thin.beams * len(thin.pitch) <= 200
    assert (min(thin.pitch), max(thin.pitch)) == (-0.5, 0.5)
    assert TILTING.thinned(27) is TILTING
    assert len(whole.thinned(1).pitch) == 1


@pytest.mark.parametrize(("text", "said"), [
    ("tilting: {beams: 3, aperture_deg: 90, pitch_deg: []}", r"tilting\.pitch_deg is \[\]"),
    ("tilting: {beams: 3, aperture_deg: 90, pitch_deg: [100]}", "is 100 degrees; give -90 to 90"),
    ("tilting: {beams: 3, aperture_deg: 400, pitch_deg: [0]}", "aperture is 400 degrees"),
    ("tilting: {beams: 0, aperture_deg: 90, pitch_deg: [0]}", "beams"),
    ("tilting: {beams: 3, aperture_deg: 90, pitch_deg: [0], roll_deg: 3}", "roll_deg"),
])  # fmt: skip
def test_bad_tilting_lasers(text: str, said: str) -> None:
    sensor = "{max_range: 5, std: 0.02, resolution: 0.01}"
    with pytest.raises(InputError, match=said):
        RangeScanner.from_yaml_text(f"parts:\n  - sensor: {sensor}\n    {text}\n")


def test_layers_and_pixels() -> None:
    vlp = RangeScanner.from_preset("velodyne-vlp-16")
    assert vlp.beams == 16 * 360 and vlp.rotation_order == 360
    assert np.degrees(np.unique(vlp.upright[:, 1])) == pytest.approx(np.arange(-15, 16, 2))
    assert np.degrees(vlp.vertical_aperture) == pytest.approx(30)
    # The corner pixels of a pinhole lie less high than those of the middle column.
    camera = RangeScanner.from_preset("realsense-d435")
    up = camera.upright[:, 1].reshape(30, 44)
    assert math.degrees(camera.aperture) == pytest.approx(87)
    assert math.degrees(up[0].max()) == pytest.approx(29, abs=0.02)
    corner = math.atan(math.tan(math.radians(29)) * math.cos(math.radians(43.5)))
    assert up[0, 0] == pytest.approx(corner)
    assert (camera.mounts[:44, 2] == np.sort(camera.mounts[:44, 2])).all()


def test_the_sampled_pattern_fills_its_field_of_view() -> None:
    """No spot of it is further than 7 degrees from a point, and it is the same every 15 degrees."""
    scanner = RangeScanner.from_preset("livox-mid-360")
    assert (scanner.beams, scanner.rotation_order) == (480, 24)
    azimuth, elevation = (
        v.ravel() for v in np.meshgrid(np.linspace(0, 0.6, 40), np.radians(np.linspace(-6, 51, 60)))
    )
    spots = np.column_stack([
        np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)
    ])  # fmt: skip
    nearest = np.arccos(np.clip((spots @ directions(scanner).T).max(axis=1), -1, 1))
    assert math.degrees(nearest.max()) < 7.0


def test_a_turn_must_keep_height_and_elevation() -> None:
    two = RangeScanner.mixed(
        RangeScanner.planar(LASER, 12, math.tau), RangeScanner.layered(LASER, 12, [0.1], z=0.3)
    )
    assert two.rotation_order == 12
    halves = np.column_stack([np.zeros(12), np.tile([0.0, 0.2], 6)])
    mixed = RangeScanner.from_mounts(LASER, two.mounts[:12], upright=halves)
    assert mixed.rotation_order == 6
    assert RangeScanner.planar(LASER, 60, math.tau, pitch=0.1).rotation_order == 1


@pytest.mark.parametrize("most", [1, 2, 7, 16, 60, 100, 360, 660])
@pytest.mark.parametrize("name", sorted(IN_SPACE - {"service-robot"}))
def test_thinned_scanners_keep_their_field_of_view(name: str, most: int) -> None:
    whole = RangeScanner.from_preset(name)
    thin = whole.thinned(most)
    assert 0.45 * min(most, whole.beams) <= thin.beams <= most
    assert thin.thinned(thin.beams).beams == thin.beams
    if most >= 60:
        up = whole.upright[:, 1]
        assert thin.upright[:, 1].min() == pytest.approx(up.min(), abs=0.2)
        assert np.ptp(thin.upright[:, 1]) == pytest.approx(np.ptp(up), rel=0.25)
        assert thin.looks_all_around == whole.looks_all_around


def test_raised() -> None:
    robot = RangeScanner.from_preset("service-robot")
    higher = robot.raised(0.1)
    assert higher.upright[:, 0] == pytest.approx(robot.upright[:, 0] + 0.1)
    assert (higher.mounts == robot.mounts).all()
    with pytest.raises(InputError, match="height is nan"):
        robot.raised(math.nan)


# -- files -------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(IN_SPACE))
def test_presets_survive_yaml(name: str, tmp_path: Path) -> None:
    scanner = RangeScanner.from_preset(name)
    scanner.to_yaml(tmp_path / "copy.yaml")
    again = RangeScanner.from_yaml(tmp_path / "copy.yaml")
    assert again == scanner
    assert len(scanner.source) > 30 and "ssum" in PRESETS.get(name).yaml
    assert not scanner.level and (scanner.upright[:, 0] > 0.0).all()
    for sensor in scanner.sensors:
        d = np.linspace(sensor.min_range, sensor.max_range, 100)
        assert (sensor.std_at(d) > 1e-4).all() and (sensor.std_at(d) < 0.5).all()


def test_listed_beams_may_have_heights() -> None:
    text = """
parts:
  - sensor: {max_range: 5, std: 0.02, resolution: 0.01}
    mounts: [[0, 0, 90, 0.5, -20], [0.1, 0, 0]]
"""
    scanner = RangeScanner.from_yaml_text(text)
    assert scanner.upright.tolist() == [[0.5, math.radians(-20)], [0.0, 0.0]]
    assert RangeScanner.from_yaml_text(scanner.to_yaml()) == scanner
    level = Mounts(((0.0, 0.0, 0.0),), ((0.0, 0.0),))
    assert level == Mounts(((0.0, 0.0, 0.0),))


SENSOR = "parts: [{sensor: {max_range: 5, std: 0.02, resolution: 0.01, aperture_deg: %s}, %s}]"


@pytest.mark.parametrize(("aperture", "layout", "fault"), [
    (0, "layers: {columns: 4, aperture_deg: 360, elevation_deg: []}", "elevation_deg"),
    (0, "layers: {columns: 4, aperture_deg: 360, elevation_deg: [95]}", r"95 degrees; give -90"),
    (0, "layers: {columns: 4, aperture_deg: 400, elevation_deg: [5]}", "400 degrees; give 0 to"),
    (0, "layers: {columns: 4, aperture_deg: 360, elevation_deg: [1, 2, 3], staggered: true}",
     "columns is 4 and there are 3 elevations"),
    (0, "layers: {columns: 4, elevation_deg: [1]}", "aperture_deg"),
    (0, "camera: {columns: 4, rows: 3, horizontal_deg: 190, vertical_deg: 58}", "less than 180"),
    (0, "camera: {columns: 0, rows: 3, horizontal_deg: 90, vertical_deg: 58}", "columns"),
    (0, "planar: {beams: 3, aperture_deg: 10, z: high}", "z is 'high'"),
    (0, "planar: {beams: 3, aperture_deg: 10, pitch_deg: 100}", "pitch is 100 degrees"),
    (0, "planar: {beams: 3, aperture_deg: 10, pitch: 0.1}", "pitch_deg"),
    (0, "mounts: [[0, 0, 0, 1]]", "give three numbers"),
    (0, "mounts: [[0, 0, 0, 1, x]]", r"mounts\[0\]\[4\] is 'x'"),
    (0, "mounts: [[0, 0, 0], [0, 0, 0, 1, 100]]", r"mounts\[1\]\[4\] is 100 degrees; give -90"),
    (0, "planar: {beams: 3, aperture_deg: 10}, layers: {columns: 1, aperture_deg: 0}",
     "planar and layers; give exactly one of planar, ring, mounts, layers, "
     "tilting, camera"),
])  # fmt: skip
def test_bad_files_are_refused(aperture: float, layout: str, fault: str) -> None:
    with pytest.raises(InputError, match=fault):
        RangeScanner.from_yaml_text(SENSOR % (aperture, layout), file="robot.yaml")


def test_bad_heights_of_listed_beams_are_refused() -> None:
    with pytest.raises(InputError, match="upright has the shape"):
        RangeScanner.from_mounts(LASER, np.zeros((2, 3)), upright=np.zeros(2))
    with pytest.raises(InputError, match="2 beams and 1 heights"):
        Mounts(((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), ((0.5, 0.0),))
