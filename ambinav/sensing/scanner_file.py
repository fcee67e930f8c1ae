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

from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields, replace
from functools import cache
from typing import Annotated, Any, NamedTuple, get_type_hints

import yaml
from pydantic import BeforeValidator, InstanceOf, TypeAdapter, create_model, model_validator

from ambinav.config import (
    ConfigModel,
    Degrees,
    MountDegrees,
    Number,
    Text,
    as_degrees,
    check_keys,
    checked,
    fault,
    number,
    of_mapping,
    parse_yaml,
    row,
    some_numbers,
)
from ambinav.runtime.errors import InputError
from ambinav.runtime.input_suggestions import SCANNER, kind_of, refuse
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.layout import Layout, Mounts, Part, Planar, Ring
from ambinav.sensing.mounting import (
    LEVEL,
    NOT_BEYOND_VERTICAL,
    Angle,
    Elevation,
    Elevations,
    FieldOfView,
    Mount,
    Turn,
)
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


_MOUNTS = TypeAdapter(
    tuple[
        Annotated[
            tuple[Number, Number, Degrees, Number, Annotated[Degrees, NOT_BEYOND_VERTICAL]],
            row(5, "give three numbers [x, y, yaw_deg], or five [x, y, yaw_deg, z, elevation_deg]"),
        ],
        ...,
    ]
)
_IN_DEGREES: dict[Any, Any] = {
    **dict.fromkeys((Angle, Turn, Elevation, FieldOfView), Degrees),
    Elevations: Annotated[tuple[Degrees, ...], some_numbers],
}
"""Types of a layout's angles in a file, where their keys end in `_deg`."""
_LEFT_OUT = ("staggered", "z", "pitch", "roll")
"""Fields that are not written where they have their default."""


@cache
def _model(kind: Any) -> type[ConfigModel]:
    """Return the model of a layout's mapping in a file: its fields in their order."""
    hints = get_type_hints(kind, include_extras=True)
    model_fields: dict[str, Any] = {}
    for field in fields(kind):
        hint = hints[field.name]
        key = f"{field.name}_deg" if hint in _IN_DEGREES else field.name
        in_file = MountDegrees if hint == Mount else _IN_DEGREES.get(hint, hint)
        model_fields[key] = in_file, ... if field.default is MISSING else field.default
    return create_model(kind.__name__, __base__=ConfigModel, **model_fields)


def layout_of(kind: Any, plain: object) -> Layout:
    """Make a layout of a class from its value in a file, where angles are degrees."""
    if kind is Mounts:
        return _mounts(plain)
    layout: Layout = kind(*(value for _, value in _model(kind).model_validate(plain)))
    return layout


def plain_of(layout: Layout) -> dict[str, object]:
    """Return a layout's key in a file, the lower-case name of its class, and its value."""
    if isinstance(layout, Mounts):
        up = [[z, as_degrees(elevation)] for z, elevation in layout.raised]
        rows = zip(layout.each, up or [[]] * len(layout.each), strict=True)
        return {"mounts": [_plain_mount(mount) + raised for mount, raised in rows]}
    kind: Any = type(layout)
    plain: dict[str, object] = {}
    for key, field in zip(_model(kind).model_fields, fields(kind), strict=True):
        value = getattr(layout, field.name)
        if field.name in _LEFT_OUT and value == field.default:
            continue
        if field.name == "mount":
            value = _plain_mount(value)
        elif key != field.name:
            value = [*map(as_degrees, value)] if isinstance(value, tuple) else as_degrees(value)
        plain[key] = value
    return {kind.__name__.lower(): plain}


def _plain_mount(mount: Mount) -> list[float]:
    """Return the YAML form of a mount: yaw in degrees."""
    return [mount[0], mount[1], as_degrees(mount[2])]


def _mounts(plain: object) -> Mounts:
    if not isinstance(plain, list):
        raise fault(plain, "give a list of [x, y, yaw_deg]")
    rows = _MOUNTS.validate_python(
        [[*row, *LEVEL] if isinstance(row, list) and len(row) == 3 else row for row in plain]
    )
    return Mounts(tuple(row[:3] for row in rows), tuple(row[3:] for row in rows))


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


def _reader(kind: type[Layout]) -> BeforeValidator:
    return BeforeValidator(lambda plain: layout_of(kind, plain))


class _PartModel(ConfigModel):
    sensor: Annotated[InstanceOf[RangeSensor], BeforeValidator(_sensor)]
    planar: Annotated[InstanceOf[Planar] | None, _reader(Planar)] = None
    ring: Annotated[InstanceOf[Ring] | None, _reader(Ring)] = None
    mounts: Annotated[InstanceOf[Mounts] | None, _reader(Mounts)] = None
    layers: Annotated[InstanceOf[Layers] | None, _reader(Layers)] = None
    tilting: Annotated[InstanceOf[Tilting] | None, _reader(Tilting)] = None
    camera: Annotated[InstanceOf[Camera] | None, _reader(Camera)] = None
    intensity: Annotated[InstanceOf[Intensity], of_mapping(Intensity)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _one_layout(cls, plain: Any) -> Any:
        if isinstance(plain, Mapping):
            check_keys(plain, cls.model_fields)
            layouts = [kind for kind in LAYOUTS if kind in plain]
            if "sensor" in plain and len(layouts) != 1:
                raise InputError(
                    f"the part has {' and '.join(layouts) or 'no layout'}; give exactly one of "
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
    plain["parts"] = [{"sensor": part.sensor.to_plain(), **plain_of(part.layout)} for part in parts]
    return yaml.safe_dump(plain, sort_keys=False, allow_unicode=True, default_flow_style=None)
