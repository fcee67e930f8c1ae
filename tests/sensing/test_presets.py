"""Every preset loads, names its source, and survives YAML."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml

from ambinav.runtime.errors import InputError
from ambinav.sensing import PRESETS, RangeScanner, preset_names, preset_summaries

DOCS = Path(__file__).parents[2] / "docs" / "scanners.md"


class Known(NamedTuple):
    """What the documents say of a device, not the files; lengths in metres, angles in degrees."""

    beams: int
    step: float | None
    aperture: float
    nearest: float
    farthest: float
    bin: float
    std: dict[float, float]
    """Standard deviation by true range."""
    kind: str = "laser"


SLAMTEC = {2.0: 0.01, 4.0: 0.04, 6.0: 0.075}  # half of 1, 2 and 2.5 %
KNOWN = {
    "hc-sr04": Known(1, None, 0, 0.02, 4.0, 0.003, {0.05: 0.0011, 2.0: 0.005}, "sonar"),
    "hokuyo-urg-04lx": Known(682, 360 / 1024, 239.4, 0.02, 4.095, 0.001, {0.5: 0.005, 4: 0.02}),
    "hokuyo-urg-04lx-ug01": Known(682, 360 / 1024, 239.4, 0.02, 5.6, 0.001, {0.5: 0.015, 4: 0.06}),
    "hokuyo-ust-10lx": Known(1081, 0.25, 270, 0.06, 10, 0.001, {5: 0.02}),
    "hokuyo-ust-20lx": Known(1081, 0.25, 270, 0.06, 20, 0.001, {15: 0.02}),
    "hokuyo-utm-30lx": Known(1081, 0.25, 270, 0.1, 30, 0.001, {5: 0.015, 20: 0.025}),
    "ldrobot-ld19": Known(450, 0.8, 360, 0.02, 12, 0.015, {0.5: 0.01, 11: 0.01}),
    "pioneer-sonar-laser": Known(197, None, 320, 0, 8.19, 0.01, {}, "mixed"),
    "polaroid-6500-ring": Known(16, 22.5, 360, 0.15, 35 * 0.3048, 0.01, {2: 0.012}, "sonar"),
    "rplidar-a1": Known(360, 1.0, 360, 0.15, 12, 0.0005, SLAMTEC),
    "rplidar-a2": Known(1600, 0.225, 360, 0.2, 12, 0.0005, SLAMTEC),
    "rplidar-a3": Known(1600, 0.225, 360, 0.2, 25, 0.0005, SLAMTEC),
    "rplidar-c1": Known(500, 0.72, 360, 0.05, 12, 0.013, {5: 0.015}),
    "rplidar-s2": Known(3200, 0.1125, 360, 0.05, 30, 0.013, {5: 0.015}),
    "sick-lms111": Known(541, 0.5, 270, 0.5, 20, 0.001, {5: 0.012}),
    "sick-lms200": Known(361, 0.5, 180, 0, 8.19, 0.001, {5: 0.005}),
    "sick-nanoscan3": Known(1651, 1 / 6, 275, 0.05, 40, 0.001, {5: 0.02}),
    "sick-tim571": Known(811, 1 / 3, 270, 0.05, 25, 0.001, {5: 0.02}),
    "sick-tim781": Known(811, 1 / 3, 270, 0.05, 25, 0.001, {5: 0.02}),
    "turtlebot3-lds": Known(360, 1, 360, 0.12, 3.5, 0.001, {0.3: 0.005, 2: 0.035}),
    "turtlebot3-lds-02": Known(360, 1, 360, 0.16, 8, 0.001, {0.2: 0.005, 2: 0.03, 7: 0.175}),
    "vl53l5cx": Known(8, 45 / 8, 45 * 7 / 8, 0.02, 3.5, 0.001, {0.1: 0.0075, 2: 0.05}, "sonar"),
    "ydlidar-g4": Known(1286, 7 * 360 / 9000, 360, 0.28, 16, 0.0005, SLAMTEC),
    "ydlidar-x4": Known(714, 7 * 360 / 5000, 360, 0.12, 10, 0.0005, SLAMTEC),
}


IN_SPACE = {
    *("livox-mid-360", "ouster-os1-32", "realsense-d435", "service-robot", "velodyne-vlp-16")
}
"""Those that look up and down: tests/sensing/test_space_scanners.py."""


def test_the_presets_of_the_issue_are_there() -> None:
    assert set(preset_names()) == set(KNOWN) | IN_SPACE


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_preset(name: str, tmp_path: Path) -> None:
    scanner = RangeScanner.from_preset(name)
    known = KNOWN[name]
    assert scanner.name == name
    assert (scanner.beams, scanner.kind) == (known.beams, known.kind)
    assert math.degrees(scanner.aperture) == pytest.approx(known.aperture, abs=0.5)
    assert scanner.max_range == pytest.approx(known.farthest, abs=0.005)
    assert min(sensor.min_range for sensor in scanner.sensors) == known.nearest
    assert len(scanner.source) > 30
    scanner.to_yaml(tmp_path / "copy.yaml")
    assert RangeScanner.from_yaml(tmp_path / "copy.yaml") == scanner
    assert RangeScanner.load(name) == scanner == RangeScanner.load(tmp_path / "copy.yaml")


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_steps_make_up_the_aperture(name: str) -> None:
    known, scanner = KNOWN[name], RangeScanner.from_preset(name)
    if known.step is None:
        return
    steps = known.beams if known.aperture == 360 else known.beams - 1
    assert steps * known.step == pytest.approx(known.aperture, abs=0.2)
    yaw = np.unwrap(scanner.mounts[:, 2])
    assert np.degrees(np.diff(yaw)) == pytest.approx(known.step, rel=1e-3)


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_figures_of_the_sensor(name: str) -> None:
    """Accuracy, deviation and bin are three things: none stands in another's place."""
    known, sensors = KNOWN[name], RangeScanner.from_preset(name).sensors
    assert sensors[0].resolution == known.bin
    for true_range, std in known.std.items():
        assert sensors[0].std_at(true_range) == pytest.approx(std, rel=0.02)
    for sensor in sensors:
        # A deviation of half a metre, or below a tenth of a millimetre, is a slip of the unit.
        d = np.linspace(sensor.min_range, sensor.max_range, 500)
        assert (sensor.std_at(d) > 1e-4).all() and (sensor.std_at(d) < 0.5).all()
        assert (np.diff(sensor.std_at(d)) >= -1e-12).all()
        assert 0.0 <= sensor.min_range < 0.6 and sensor.max_range <= 40.0
        assert sensor.bias == 0.0


def test_preset_files_say_what_is_assumed() -> None:
    for name in preset_names():
        assert "ssum" in PRESETS.get(name).yaml


def test_a_figure_without_a_document_says_so() -> None:
    """Every deviation has a remark: the document and its figure, or that none was found."""
    for name in preset_names():
        text = PRESETS.get(name).yaml
        for match in re.finditer(r"^( +)std:", text, re.MULTILINE):
            before = text[: match.start()].splitlines()[-1].strip()
            line = text[match.start() :].splitlines()[0]
            assert before.startswith("#") or "#" in line or "as in" in text, name
        assert "page" in text or "no page" in text or name in NO_PAGES, name


NO_PAGES = {"hokuyo-utm-30lx", "pioneer-sonar-laser", "polaroid-6500-ring", "sick-lms111",
            "sick-lms200", "rplidar-a3", "ydlidar-x4", "ydlidar-g4", "ldrobot-ld19",
            "turtlebot3-lds"}  # fmt: skip
"""Sources without pages: web pages, parameter files, and documents that named none."""


@pytest.mark.slow
def test_who_looks_all_around() -> None:
    around = {n for n in preset_names() if RangeScanner.from_preset(n).looks_all_around}
    assert around == {
        *("ldrobot-ld19", "polaroid-6500-ring", "rplidar-a1", "rplidar-a2", "rplidar-a3"),
        *("rplidar-c1", "rplidar-s2", "turtlebot3-lds", "turtlebot3-lds-02"),
        *("ydlidar-g4", "ydlidar-x4", "livox-mid-360", "ouster-os1-32", "velodyne-vlp-16"),
    }
    # The TurtleBot3's laser sits 3.2 cm off the robot's centre: turning on the spot moves it.
    burger = RangeScanner.from_preset("turtlebot3-lds")
    assert not burger.turns_in_place
    assert burger.centred.turns_in_place
    assert np.abs(burger.centred.mounts[:, :2]).max() < 1e-12


@pytest.mark.slow
def test_summaries() -> None:
    summaries = {s.name: s for s in preset_summaries()}
    assert tuple(summaries) == preset_names()
    assert summaries["hokuyo-urg-04lx"].row()[:5] == (
        *("hokuyo-urg-04lx", "laser", "682", "239°", "4.095 m"),
    )
    # Cones count with their own width.
    assert summaries["hc-sr04"].row()[1:4] == ("cone", "1", "21°")
    assert summaries["vl53l5cx"].row()[1:4] == ("cone", "8", "45°")
    assert summaries["polaroid-6500-ring"].row()[3] == "360°"


def test_the_page_of_scanners_is_that_of_the_presets() -> None:
    """One row for each preset, with its range, step, deviation and bin as the files have them."""
    rows = [
        [cell.strip() for cell in line.strip("|\n").split("|")]
        for line in DOCS.read_text().splitlines()
        if line.startswith("| `")
    ]
    assert [row[0].strip("`") for row in rows] == list(preset_names())
    for name, reach, step, std, width, _ in rows:
        scanner = RangeScanner.from_preset(name.strip("`"))
        sensor = scanner.sensors[-1]
        near, far = (float(v) for v in re.findall(r"[\d.]+", reach))
        assert (near, far) == pytest.approx((sensor.min_range, scanner.max_range), abs=0.006)
        assert float(width.split()[0]) == pytest.approx(sensor.resolution * 1000)
        stated = [float(v) / 1000 for v in re.findall(r"([\d.]+)(?= |$)", std.split(" mm")[0])]
        d = np.linspace(sensor.min_range, sensor.max_range, 5000)
        least, most = sensor.std_at(d).min(), sensor.std_at(d).max()
        assert stated[0] == pytest.approx(least, abs=6e-4), name
        assert stated[-1] == pytest.approx(most, rel=0.02), name
        if step.endswith("°"):
            gaps = np.degrees(np.diff(np.unwrap(scanner.mounts[:, 2])))
            assert float(step.rstrip("°")) == pytest.approx(np.median(gaps), abs=0.006), name


def test_unknown_preset_offers_the_nearest() -> None:
    with pytest.raises(InputError, match=r"'sick'; did you mean .*sick-nanoscan3, sick-tim571"):
        RangeScanner.from_preset("sick")  # all that contain the word
    with pytest.raises(InputError, match=r"no scanner preset 'hokuyo-urg-4lx'.*hokuyo-urg-04lx"):
        RangeScanner.load("hokuyo-urg-4lx")
    with pytest.raises(InputError, match="choose from hc-sr04, hokuyo-urg-04lx"):
        RangeScanner.from_preset("qqq")
    with pytest.raises(InputError, match=r"my/robot\.yaml: the file cannot be read"):
        RangeScanner.load("my/robot.yaml")


def test_the_files_hold_nothing_but_known_fields() -> None:
    for name in preset_names():
        found = set(yaml.safe_load(PRESETS.get(name).yaml))
        assert found - {"robot_radius"} == {"name", "description", "source", "parts"}


def test_scanners_of_a_known_robot_say_its_radius() -> None:
    for name in ("turtlebot3-lds", "turtlebot3-lds-02"):
        scanner = RangeScanner.from_preset(name)
        # Corners of the box behind the axle, the furthest points of the Burger.
        assert scanner.robot_radius == pytest.approx(math.hypot(0.032 + 0.07, 0.07), abs=1e-3)
