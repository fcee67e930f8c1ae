"""Scanner files: YAML text to the parts of a scanner and back.

name: my-robot
description: two lasers and a sonar ring
source: where the figures come from
robot_radius: 0.2                       # optional: of the disc that covers the robot, metres
parts:
  - sensor: sick-lms200                 # the sensor of a preset, or a mapping of its fields
    intensity: {wall: 0.3, reflector: 1.0, std: 0.15}   # optional: adds the channel to the sensor
    planar: {beams: 181, aperture_deg: 180, mount: [0.1, 0, 0]}     # x, y, yaw_deg
  - sensor: {max_range: 5, std: 0.02, resolution: 0.01, aperture_deg: 30}
    ring: {count: 16, radius: 0.2, start_deg: 0}                     # or
    # mounts: [[0.1, 0.1, 90], [0.1, -0.1, -90]]
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import yaml
from pydantic import BeforeValidator, InstanceOf, TypeAdapter, model_validator

from ambinav.config import (
    ConfigModel,
    Count,
    Degrees,
    MountDegrees,
    Number,
    Text,
    check_keys,
    checked,
    fault,
    number,
    of_mapping,
    parse_yaml,
)
from ambinav.errors import InputError
from ambinav.mistaken import SCANNER, kind_of, refuse
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.layout import CENTRE, Mounts, Part, Planar, Ring
from ambinav.sensing.presets import PRESETS
from ambinav.sensing.sensor import RangeSensor

EXAMPLE = "`ambinav presets NAME` prints one as an example"


class ScannerText(NamedTuple):
    """What a scanner file says."""

    name: str
    description: str
    source: str
    parts: tuple[Part, ...]
    robot_radius: float | None


_MOUNTS = TypeAdapter(tuple[MountDegrees, ...])


class _PlanarModel(ConfigModel):
    beams: Count
    aperture_deg: Degrees
    mount: MountDegrees = CENTRE


class _RingModel(ConfigModel):
    count: Count
    radius: Number
    start_deg: Degrees = 0.0


def _planar(plain: object) -> Planar:
    model = _PlanarModel.model_validate(plain)
    return Planar(model.beams, model.aperture_deg, model.mount)


def _ring(plain: object) -> Ring:
    model = _RingModel.model_validate(plain)
    return Ring(model.count, model.radius, model.start_deg)


def _mounts(plain: object) -> Mounts:
    if not isinstance(plain, list):
        raise fault(plain, "give a list of [x, y, yaw_deg]")
    return Mounts(_MOUNTS.validate_python(plain))


def _sensor(plain: object) -> RangeSensor:
    """A sensor from its fields, or that of a preset."""
    if not isinstance(plain, str):
        return RangeSensor.from_plain(plain, "sensor")
    preset = PRESETS.get(plain)
    origin = preset.origin or PRESETS.calling(plain).whose
    kinds = {part.sensor for part in parse_scanner(preset.yaml, origin, plain).parts}
    if len(kinds) != 1:
        raise InputError(
            f"the preset {plain!r} has {len(kinds)} kinds of sensor; name one that has a single "
            "kind."
        )
    return kinds.pop()


class _PartModel(ConfigModel):
    sensor: Annotated[InstanceOf[RangeSensor], BeforeValidator(_sensor)]
    planar: Annotated[InstanceOf[Planar] | None, BeforeValidator(_planar)] = None
    ring: Annotated[InstanceOf[Ring] | None, BeforeValidator(_ring)] = None
    mounts: Annotated[InstanceOf[Mounts] | None, BeforeValidator(_mounts)] = None
    intensity: Annotated[InstanceOf[Intensity] | None, of_mapping(Intensity)] = None

    @model_validator(mode="before")
    @classmethod
    def _one_layout(cls, plain: Any) -> Any:
        if isinstance(plain, Mapping):
            check_keys(plain, cls.model_fields)
            given = [kind for kind in ("planar", "ring", "mounts") if kind in plain]
            if "sensor" in plain and len(given) != 1:
                raise InputError(
                    f"the part has {' and '.join(given) or 'no layout'}; give exactly one of "
                    "planar, ring, mounts."
                )
        return plain

    @property
    def part(self) -> Part:
        """The part."""
        layout = self.planar or self.ring or self.mounts
        assert layout is not None  # one of them is given, and null is none of them
        if self.intensity is None:
            return Part(self.sensor, layout)
        return Part(replace(self.sensor, intensity=self.intensity), layout)


def _listed(parts: object) -> object:
    if not isinstance(parts, list) or not parts:
        raise fault(parts, "give a list of parts, each with a sensor and a layout")
    return parts


class _ScannerModel(ConfigModel):
    name: Text = ""
    description: Text = ""
    source: Text = ""
    robot_radius: Annotated[float | None, number(above=0)] = None
    parts: Annotated[tuple[_PartModel, ...], BeforeValidator(_listed)]


def parse_scanner(text: str, where: str, default_name: str) -> ScannerText:
    """Read a scanner from YAML text; `where` names it in messages.

    Raises:
        InputError: the text or a field cannot be used.
    """
    plain = parse_yaml(text, where, EXAMPLE)
    refuse(where, kind_of(plain), "a scanner", SCANNER)
    model = checked(_ScannerModel, plain, where)
    return ScannerText(
        model.name or default_name,
        model.description,
        model.source,
        tuple(part.part for part in model.parts),
        model.robot_radius,
    )


def render_scanner(
    name: str,
    description: str,
    source: str,
    parts: Sequence[Part],
    robot_radius: float | None = None,
) -> str:
    """Return the YAML text of a scanner; sensors are written out."""
    plain: dict[str, object] = {"name": name, "description": description, "source": source}
    plain = {key: value for key, value in plain.items() if value}
    if robot_radius is not None:
        plain["robot_radius"] = robot_radius
    plain["parts"] = [
        {"sensor": part.sensor.to_plain(), **part.layout.to_plain()} for part in parts
    ]
    return yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, default_flow_style=None)
