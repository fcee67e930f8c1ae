"""Sensor models that plug-ins bring: what a scanner file says of them, and what it makes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest

from ambinav import InputError, RangeScanner, RangeSensor
from ambinav.config import Positive, check_fields
from ambinav.sensing.curves import Polynomial
from ambinav.sensing.sensor_models import SENSOR_MODELS, SensorModel

SCANNER = "parts: [{{sensor: {}, planar: {{beams: 8, aperture_deg: 360}}}}]"


@dataclass(frozen=True)
class Radar:
    """Metres."""

    max_range: Positive
    error: Positive = 0.01

    def __post_init__(self) -> None:
        check_fields(self)


def make(radar: Radar) -> RangeSensor:
    return RangeSensor(
        max_range=radar.max_range, resolution=0.05, std=Polynomial((0.0, radar.error))
    )


def register(monkeypatch: pytest.MonkeyPatch, make: Any) -> None:
    monkeypatch.setattr(SENSOR_MODELS, "_registered", {})
    SENSOR_MODELS.register(SensorModel(name="radar", title="", parameters=Radar, make=make))


def scanner(sensor: str) -> RangeScanner:
    return RangeScanner.from_yaml_text(SCANNER.format(sensor), file="a.yaml")


def test_a_model_makes_the_sensor(monkeypatch: pytest.MonkeyPatch) -> None:
    register(monkeypatch, make)
    made = scanner("{model: radar, max_range: 4, error: 0.02}")
    assert made.sensors[0].std_at(2.0) == pytest.approx(0.04)
    # Written out, it needs the model no more.
    monkeypatch.setattr(SENSOR_MODELS, "_registered", {})
    assert RangeScanner.from_yaml_text(made.to_yaml()).sensors == made.sensors


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ("{model: rader, max_range: 4}", "there is no sensor model 'rader'; did you mean radar"),
        ("{model: radar, range: 4}", "the key 'range' is unknown; did you mean max_range"),
        ("{model: radar}", "the key 'max_range' is missing; add it"),
        ("{model: radar, max_range: -1}", "max_range is -1"),
    ],
)
def test_what_a_file_says_wrong(monkeypatch: pytest.MonkeyPatch, sensor: str, message: str) -> None:
    register(monkeypatch, make)
    with pytest.raises(InputError) as caught:
        scanner(sensor)
    assert str(caught.value).startswith("a.yaml: parts[0].sensor: ") and message in str(
        caught.value
    )


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (lambda radar: radar.nothing, r"failed \(AttributeError: 'Radar' object has no"),
        (lambda radar: None, "what it gives cannot be used .it is not a RangeSensor but None"),
    ],
)
def test_a_broken_model(monkeypatch: pytest.MonkeyPatch, broken: Any, message: str) -> None:
    register(monkeypatch, broken)
    with pytest.raises(InputError, match=f"a.yaml: .*sensor model 'radar', registered .*{message}"):
        scanner("{model: radar, max_range: 4}")
