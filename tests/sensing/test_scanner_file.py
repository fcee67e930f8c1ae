"""Scanner files: what is written comes back, and what is wrong is named."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from ambinav.runtime.errors import InputError
from ambinav.sensing import Intensity, RangeScanner, RangeSensor

LASER = RangeSensor(name="laser", max_range=4.0, std=0.03, resolution=0.001)
SONAR = RangeSensor(
    name="sonar", max_range=6.0, std=0.02, resolution=0.01, aperture=math.radians(30)
)
MIRRORED = RangeSensor(
    name="mirrored",
    max_range=6.0,
    std=0.02,
    resolution=0.01,
    aperture=math.radians(30),
    max_incidence=math.radians(12),
)

Array = NDArray[Any]


SENSOR_TEXT = "{max_range: 4, std: 0.03, resolution: 0.001}"
ROUND = f"{{sensor: {SENSOR_TEXT}, planar: {{beams: 36, aperture_deg: 360}}}}"


def test_yaml_of_every_layout(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(
        f"""
source: a data sheet
parts:
  - sensor: {SENSOR_TEXT}
    planar: {{beams: 3, aperture_deg: 90, mount: [0.1, 0, 180]}}
  - sensor: polaroid-6500-ring
    ring: {{count: 8, radius: 0.3}}
  - sensor: {SENSOR_TEXT}
    mounts: [[0, 0.1, 90], [0, -0.1, -90]]
"""
    )
    scanner = RangeScanner.from_yaml(path)
    assert scanner.name == "robot"
    assert scanner.beams == 13
    assert len(scanner.sensors) == 2
    assert np.rad2deg(scanner.mounts[:3, 2]) == pytest.approx([135, 180, 225])
    assert scanner.mounts[-1] == pytest.approx([0, -0.1, -math.pi / 2])
    assert RangeScanner.from_yaml_text(scanner.to_yaml()) == scanner


def test_yaml_of_thinned_and_shuffled() -> None:
    for name in ("hokuyo-urg-04lx", "pioneer-sonar-laser"):
        thin = RangeScanner.from_preset(name).thinned(50)
        again = RangeScanner.from_yaml_text(thin.to_yaml())
        assert again.mounts == pytest.approx(thin.mounts, abs=1e-14)
        assert again.sensors == thin.sensors


def part(text: str) -> str:
    return f"parts: [{{sensor: {SENSOR_TEXT}, {text}}}]"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("name: x", "the key 'parts' is missing"),
        ("parts: []", "parts is []; give a list of parts"),
        ("pats: []", "the key 'pats' is unknown; did you mean parts"),
        ("parts: [3]", "parts[0] is 3; give a mapping"),
        ("parts: [{planar: {beams: 3}}]", "parts[0]: the key 'sensor' is missing"),
        (
            "parts: [{sensor: sick-lms20, ring: {count: 1, radius: 0}}]",
            "no scanner preset 'sick-lms20'; did you mean sick-lms2",
        ),
        (
            "parts: [{sensor: pioneer-sonar-laser, ring: {count: 1, radius: 0}}]",
            "has 2 kinds of sensor",
        ),
        (f"parts: [{{sensor: {SENSOR_TEXT}}}]", "the part has no layout; give exactly one of"),
        (part("plannar: {}"), "'plannar' is unknown; did you mean planar"),
        (part("ring: {}, planar: {}"), "the part has planar and ring; give exactly one"),
        (part("planar: {beams: 3}"), "parts[0].planar: the key 'aperture_deg' is missing"),
        (part("planar: {beams: 3, aperture: 1}"), "'aperture' is unknown; did you mean aperture_d"),
        (part("planar: {beams: 0, aperture_deg: 1}"), "planar.beams is 0; give a whole number"),
        (part("planar: {beams: 2.5, aperture_deg: 1}"), "beams is 2.5"),
        (part("planar: {beams: 2, aperture_deg: 400}"), "aperture is 400 degrees"),
        (part("planar: {beams: 2, aperture_deg: 4, mount: [0, 0]}"), "mount is [0, 0]; give three"),
        (part("ring: {count: 4, radius: -1}"), "ring.radius is -1; give a number of at least 0"),
        (part("mounts: []"), "mounts is empty"),
        (part("mounts: [[0, 0, .nan]]"), "mounts[0][2] is nan"),
        (part("mounts: 5"), "mounts is 5; give a list"),
        (
            "parts: [{sensor: {max_range: 1, min_range: 2, std: 0, resolution: 0.1}, ring: {}}]",
            "parts[0].sensor: max_range is 1.0",
        ),
    ],
)
def test_bad_scanner_files_name_file_and_field(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        RangeScanner.from_yaml(path)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=2)
    ),
    max_leaves=5,
)


@pytest.mark.slow
@settings(max_examples=50)
@given(
    field=st.sampled_from(
        [
            *("name", "source", "parts", "sensor", "planar", "ring", "mounts", "max_range", "std"),
            *("resolution", "aperture_deg", "bias", "random_share", "beams", "mount", "table"),
        ]
    ),
    junk=JUNK,
)
def test_junk_in_any_field_gives_a_scanner_or_a_sentence(field: str, junk: object) -> None:
    def spoilt(plain: object) -> object:
        if isinstance(plain, dict):
            return {k: junk if k == field else spoilt(v) for k, v in plain.items()}
        return [spoilt(item) for item in plain] if isinstance(plain, list) else plain

    text = RangeScanner.from_preset("pioneer-sonar-laser").to_yaml()
    try:
        RangeScanner.from_yaml_text(yaml.safe_dump(spoilt(yaml.safe_load(text))), file="f.yaml")
    except InputError as error:
        assert str(error).startswith("f.yaml")


def test_bad_arguments() -> None:
    with pytest.raises(InputError, match="has no beams"):
        RangeScanner.mixed()
    with pytest.raises(InputError, match=r"shape \(2,\)"):
        RangeScanner.from_mounts(LASER, [0.0, 1.0])
    with pytest.raises(InputError, match="index from 0 to 0"):
        RangeScanner.from_mounts(LASER, np.zeros((2, 3)), [0, 1])
    with pytest.raises(InputError, match="nan"):
        RangeScanner.from_mounts(LASER, [[0.0, 0.0, math.nan]])
    with pytest.raises(InputError, match="beams is 0"):
        RangeScanner.planar(LASER, 0, 1.0)
    with pytest.raises(InputError, match=r"radius is -0\.1"):
        RangeScanner.ring(SONAR, 8, -0.1)


def test_nothing_is_written_to_a_bad_place(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(InputError, match="choose another output"):
        RangeScanner.planar(LASER, 3, 1.0).to_yaml(tmp_path / "file" / "robot.yaml")


def test_the_radius_of_the_robot_comes_back(tmp_path: Path) -> None:
    text = f"robot_radius: 0.35\nparts: [{ROUND}]"
    scanner = RangeScanner.from_yaml_text(text)
    assert scanner.robot_radius == 0.35
    scanner.to_yaml(tmp_path / "robot.yaml")
    assert RangeScanner.from_yaml(tmp_path / "robot.yaml") == scanner
    assert scanner.thinned(12).robot_radius == 0.35
    bare = RangeScanner.planar(LASER, 12, math.tau)
    assert bare.robot_radius is None and "robot_radius" not in bare.to_yaml()
    # One robot carries both: the larger disc covers it.
    assert RangeScanner.mixed(scanner, bare).robot_radius == 0.35
    assert RangeScanner.mixed(bare, bare).robot_radius is None


@pytest.mark.parametrize("value", ["0", "-0.2", "wide", ".inf", "[0.2]"])
def test_a_radius_that_no_robot_has(value: str) -> None:
    text = f"robot_radius: {value}\nparts: [{ROUND}]"
    with pytest.raises(InputError, match=r"robot\.yaml: robot_radius is"):
        RangeScanner.from_yaml_text(text, file="robot.yaml")
    with pytest.raises(InputError, match="robot_radius is 0"):
        RangeScanner(RangeScanner.planar(LASER, 12, math.tau).parts, robot_radius=0.0)


CHANNEL = "{wall: 0.3, reflector: 1.0, std: 0.15}"


def test_an_intensity_channel_is_read_written_and_added(tmp_path: Path) -> None:
    """In a sensor, beside a preset's, and by a method; the channel counts for equality."""
    fields = SENSOR_TEXT.rstrip("}")
    own = RangeScanner.from_yaml_text(
        f"parts: [{{sensor: {fields}, intensity: {CHANNEL}}}, "
        "planar: {beams: 4, aperture_deg: 90}}]"
    )
    beside = RangeScanner.from_yaml_text(
        f"parts: [{{sensor: {SENSOR_TEXT}, intensity: {CHANNEL}, "
        "planar: {beams: 4, aperture_deg: 90}}]"
    )
    assert own == beside
    channel = own.sensors[0].intensity
    assert channel == Intensity(wall=0.3, reflector=1.0, std=0.15)
    assert RangeScanner.from_yaml_text(own.to_yaml()) == own
    assert own.intensity_beams.tolist() == [0, 1, 2, 3]
    plain = own.with_intensity(None)
    assert plain != own
    assert "intensity" not in plain.to_yaml()
    assert plain.with_intensity(channel) == own
    # The laser of a robot that has sonars too.
    pioneer = RangeScanner.from_preset("pioneer-sonar-laser").with_intensity(channel)
    assert (pioneer.intensity_beams >= 16).all()
    assert len(pioneer.intensity_beams) == pioneer.beams - 16
    thinned = own.thinned(2)
    assert thinned.intensity_beams.tolist() == [0, 1]


@pytest.mark.parametrize(
    ("channel", "complaint"),
    [
        ("{wall: 0.3, std: 0.1}", "'reflector' is missing"),
        ("{wall: 0.3, reflector: 0.2, std: 0.1}", "reflector is 0.2; give more than wall"),
        ("{wall: 0.3, reflector: 1, std: 0}", "std is 0; give a number above 0"),
        ("{wall: .nan, reflector: 1, std: 1}", "wall is nan; give a number of at least 0"),
        ("{wall: 0.3, reflector: 1, std: 1, bright: 2}", "the key 'bright' is unknown"),
        ("7", "is 7; give a mapping"),
    ],
)
def test_a_channel_that_makes_no_sense_is_refused(channel: str, complaint: str) -> None:
    """One sentence that names file, field and value, wherever the channel stands."""
    layout = "planar: {beams: 4, aperture_deg: 90}"
    fields = SENSOR_TEXT.rstrip("}")
    for part in (
        f"{{sensor: {SENSOR_TEXT}, intensity: {channel}, {layout}}}",
        f"{{sensor: {fields}, intensity: {channel}}}, {layout}}}",
    ):
        with pytest.raises(InputError, match=r"^robot.yaml: parts\[0\]") as error:
            RangeScanner.from_yaml_text(f"parts: [{part}]", file="robot.yaml")
        assert complaint in str(error.value)
        assert str(error.value).count(". ") == 0


def test_sonars_read_no_intensity() -> None:
    """An echo of a cone is of no one surface."""
    channel = Intensity(wall=0.3, reflector=1.0, std=0.15)
    with pytest.raises(InputError, match="intensity is given with an aperture of 30 degrees"):
        RangeSensor(
            max_range=4.0, std=0.03, resolution=0.01, aperture=math.radians(30), intensity=channel
        )
    with pytest.raises(InputError, match="has no laser"):
        RangeScanner.from_preset("polaroid-6500-ring").with_intensity(channel)


def test_how_well_a_channel_tells_surfaces_apart() -> None:
    """The stated probability is that of readings, and of the normal distribution."""
    channel = Intensity(wall=0.3, reflector=1.0, std=0.25)
    assert channel.distinguished == pytest.approx(0.9192433, abs=1e-6)
    bright = np.arange(200_000) % 2 == 0
    read = channel.read(bright, np.random.default_rng(0))
    assert ((read > 0.65) == bright).mean() == pytest.approx(channel.distinguished, abs=3e-3)
    assert read.min() >= 0.0
