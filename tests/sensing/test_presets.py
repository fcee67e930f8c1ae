"""Every preset loads, names its source, and survives YAML."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from ambinav.errors import InputError
from ambinav.sensing import RangeScanner, preset_names, preset_summaries

# beams, kind, aperture in degrees, farthest range: from the data sheets, not from the files.
KNOWN = {
    "hokuyo-urg-04lx": (682, "laser", 240, 4.095),
    "hokuyo-utm-30lx": (1081, "laser", 270, 30.0),
    "pioneer-sonar-laser": (197, "mixed", 320, 8.0),
    "polaroid-6500-ring": (16, "sonar", 360, 35 * 0.3048),
    "rplidar-a1": (360, "laser", 360, 12.0),
    "sick-lms111": (541, "laser", 270, 20.0),
    "sick-lms200": (361, "laser", 180, 8.0),
    "turtlebot3-lds": (360, "laser", 360, 3.5),
}


def test_the_presets_of_the_issue_are_there() -> None:
    assert set(preset_names()) == set(KNOWN)


@pytest.mark.parametrize("name", sorted(KNOWN))
def test_preset(name: str, tmp_path: Path) -> None:
    scanner = RangeScanner.from_preset(name)
    beams, kind, aperture, max_range = KNOWN[name]
    assert scanner.name == name
    assert (scanner.beams, scanner.kind) == (beams, kind)
    assert math.degrees(scanner.aperture) == pytest.approx(aperture, abs=1.0)
    assert scanner.max_range == pytest.approx(max_range, abs=0.01)
    assert len(scanner.source) > 30
    scanner.to_yaml(tmp_path / "copy.yaml")
    assert RangeScanner.from_yaml(tmp_path / "copy.yaml") == scanner
    assert RangeScanner.load(name) == scanner == RangeScanner.load(tmp_path / "copy.yaml")


def test_preset_files_say_what_is_assumed() -> None:
    from ambinav.sensing import preset_path

    for name in preset_names():
        assert "ssum" in preset_path(name).read_text()


def test_who_looks_all_around() -> None:
    around = {n for n in preset_names() if RangeScanner.from_preset(n).looks_all_around}
    assert around == {"polaroid-6500-ring", "rplidar-a1", "turtlebot3-lds"}
    # The TurtleBot3's laser sits 3.2 cm off the robot's centre: turning on the spot moves it.
    burger = RangeScanner.from_preset("turtlebot3-lds")
    assert not burger.turns_in_place
    assert burger.centred.turns_in_place
    assert np.abs(burger.centred.mounts[:, :2]).max() < 1e-12


def test_summaries() -> None:
    summaries = preset_summaries()
    assert [s.name for s in summaries] == list(preset_names())
    assert summaries[0].row()[:5] == ("hokuyo-urg-04lx", "laser", "682", "239°", "4.095 m")


def test_unknown_preset_offers_the_nearest() -> None:
    with pytest.raises(InputError, match=r"no scanner preset 'hokuyo-urg-4lx'.*hokuyo-urg-04lx"):
        RangeScanner.load("hokuyo-urg-4lx")
    with pytest.raises(InputError, match="choose from hokuyo-urg-04lx, hokuyo-utm-30lx"):
        RangeScanner.from_preset("xyz")
    with pytest.raises(InputError, match=r"my/robot\.yaml: the file cannot be read"):
        RangeScanner.load("my/robot.yaml")
