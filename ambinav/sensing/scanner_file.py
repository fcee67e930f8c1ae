"""Scanner files: conversion of YAML text to the parts of a scanner and back.

name: my-robot
description: two lasers and a sonar ring
source: where the figures come from
robot_radius: 0.2                       # optional: of the disc that covers the robot, metres
parts:
  - sensor: sick-lms200                 # the sensor of a preset, or a mapping of its fields
    intensity: {wall: 0.3, reflector: 1.0, std: 0.15}   # optional: adds the channel to the sensor
    planar: {beams: 181, aperture_deg: 180, mount: [0.1, 0, 0]}     # x, y, yaw_deg; also
    #       z: 0.3, pitch_deg: 10, roll_deg: 0      # height above the floor; down is positive
  - sensor: {max_range: 5, std: 0.02, resolution: 0.01, aperture_deg: 30}
    ring: {count: 16, radius: 0.2, start_deg: 0}                     # or
    # mounts: [[0.1, 0.1, 90], [0.1, -0.1, -90]]    # each of them or [x, y, yaw_deg, z,
    #                                                 elevation_deg]; or, in space,
    # layers: {columns: 360, aperture_deg: 360, elevation_deg: [-15, 0, 15], mount: [0, 0, 0],
    #          z: 0.5}                                # staggered: true: a column has one of them
    # tilting: {beams: 181, aperture_deg: 180, pitch_deg: [-30, 0, 30], z: 0.5}    # a fan at each
    # camera: {columns: 40, rows: 24, horizontal_deg: 87, vertical_deg: 58, z: 0.5}
"""

from __future__ import annotations

import math
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
    Numbers,
    Switch,
    Text,
    check_keys,
    checked,
    fault,
    number,
    of_mapping,
    parse_yaml,
    row,
)
from ambinav.runtime.errors import InputError
from ambinav.runtime.input_suggestions import SCANNER, kind_of, refuse
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.layout import Layout, Mounts, Part, Planar, Ring
from ambinav.sensing.mounting import CENTRE, LEVEL
from ambinav.sensing.presets import PRESETS
from ambinav.sensing.sensor import RangeSensor
from ambinav.sensing.space_layout import Camera, Layers
from ambinav.sensing.tilting_layout import Tilting

LAYOUTS = ("planar", "ring", "mounts", "layers", "tilting", "camera")
EXAMPLE = "`ambinav presets NAME` prints one as an example"


class ScannerText(NamedTuple):
    """Contents of a scanner file."""

    name: str
    description: str
    source: str
    parts: tuple[Part, ...]
    robot_radius: float | None


_MOUNTS = TypeAdapter(tuple[MountDegrees, ...])
_UPRIGHT = TypeAdapter(
    tuple[
        Annotated[
            tuple[Number, Degrees],
            row(2, "give three numbers [x, y, yaw_deg], or five [x, y, yaw_deg, z, elevation_deg]"),
        ],
        ...,
    ]
)


class _MountedModel(ConfigModel):
    mount: MountDegrees = CENTRE
    z: Number = 0.0
    pitch_deg: Degrees = 0.0
    roll_deg: Degrees = 0.0

    @property
    def mounted(self) -> tuple[tuple[float, float, float], float, float, float]:
        """Mount, z, pitch and roll."""
        return self.mount, self.z, self.pitch_deg, self.roll_deg


class _PlanarModel(_MountedModel):
    beams: Count
    aperture_deg: Degrees


class _RingModel(ConfigModel):
    count: Count
    radius: Number
    start_deg: Degrees = 0.0
    z: Number = 0.0


class _LayersModel(_MountedModel):
    columns: Count
    aperture_deg: Degrees
    elevation_deg: Numbers
    staggered: Switch = False


class _TiltingModel(ConfigModel):
    beams: Count
    aperture_deg: Degrees
    pitch_deg: Numbers
    mount: MountDegrees = CENTRE
    z: Number = 0.0


class _CameraModel(_MountedModel):
    columns: Count
    rows: Count
    horizontal_deg: Degrees
    vertical_deg: Degrees


def _planar(plain: object) -> Planar:
    model = _PlanarModel.model_validate(plain)
    return Planar(model.beams, model.aperture_deg, *model.mounted)


def _ring(plain: object) -> Ring:
    model = _RingModel.model_validate(plain)
    return Ring(model.count, model.radius, model.start_deg, model.z)


def _mounts(plain: object) -> Mounts:
    if not isinstance(plain, list):
        raise fault(plain, "give a list of [x, y, yaw_deg]")
    long = [isinstance(row, list) and len(row) == 5 for row in plain]
    each = [row[:3] if is_long else row for row, is_long in zip(plain, long, strict=True)]
    if not any(long):
        return Mounts(_MOUNTS.validate_python(each))
    up = [row[3:] if is_long else LEVEL for row, is_long in zip(plain, long, strict=True)]
    return Mounts(_MOUNTS.validate_python(each), _UPRIGHT.validate_python(up))


def _layers(plain: object) -> Layers:
    model = _LayersModel.model_validate(plain)
    elevation = tuple(math.radians(angle) for angle in model.elevation_deg)
    return Layers(model.columns, model.aperture_deg, elevation, model.staggered, *model.mounted)


def _tilting(plain: object) -> Tilting:
    model = _TiltingModel.model_validate(plain)
    pitch = tuple(math.radians(angle) for angle in model.pitch_deg)
    return Tilting(model.beams, model.aperture_deg, pitch, model.mount, model.z)


def _camera(plain: object) -> Camera:
    model = _CameraModel.model_validate(plain)
    fields = model.columns, model.rows, model.horizontal_deg, model.vertical_deg
    return Camera(*fields, *model.mounted)


def _sensor(plain: object) -> RangeSensor:
    """Make a sensor from its fields, or return that of a preset."""
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
    layers: Annotated[InstanceOf[Layers] | None, BeforeValidator(_layers)] = None
    tilting: Annotated[InstanceOf[Tilting] | None, BeforeValidator(_tilting)] = None
    camera: Annotated[InstanceOf[Camera] | None, BeforeValidator(_camera)] = None
    intensity: Annotated[InstanceOf[Intensity], of_mapping(Intensity)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_layout(cls, plain: Any) -> Any:
        if isinstance(plain, Mapping):
            check_keys(plain, cls.model_fields)
            given = [kind for kind in LAYOUTS if kind in plain]
            if "sensor" in plain and len(given) != 1:
                raise InputError(
                    f"the part has {' and '.join(given) or 'no layout'}; give exactly one of "
                    f"{', '.join(LAYOUTS)}."
                )
        return plain

    @model_validator(mode="after")
    def _suits(self) -> _PartModel:
        _ = self.part
        return self

    @property
    def part(self) -> Part:
        """Part of the scanner."""
        layouts = (getattr(self, kind) for kind in LAYOUTS)
        # One of them is given, and null is none of them.
        layout: Layout = next(layout_given for layout_given in layouts if layout_given is not None)
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
    robot_radius: Annotated[float, number(above=0)] | None = None
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
