"""Scanner files: YAML text to the parts of a scanner and back.

name: my-robot
description: two lasers and a sonar ring
source: where the figures come from
robot_radius: 0.2                       # optional: of the disc that covers the robot, metres
parts:
  - sensor: sick-lms200                 # the sensor of a preset, or a mapping of its fields
    planar: {beams: 181, aperture_deg: 180, mount: [0.1, 0, 0]}     # x, y, yaw_deg
  - sensor: {max_range: 5, std: 0.02, resolution: 0.01, aperture_deg: 30}
    ring: {count: 16, radius: 0.2, start_deg: 0}                     # or
    # mounts: [[0.1, 0.1, 90], [0.1, -0.1, -90]]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import yaml

from ambinav.config import Fields, parse_yaml
from ambinav.errors import InputError
from ambinav.mistaken import SCANNER, kind_of, refuse
from ambinav.sensing.layout import KINDS, Part, layout_from_plain
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


def parse_scanner(text: str, where: str, default_name: str) -> ScannerText:
    """Read a scanner from YAML text; `where` names it in messages.

    Raises:
        InputError: the text or a field cannot be used.
    """
    plain = parse_yaml(text, where, EXAMPLE)
    refuse(where, kind_of(plain), "a scanner", SCANNER)
    given = Fields(plain, where, ScannerText._fields)
    parts = given.raw("parts")
    if not isinstance(parts, list) or not parts:
        raise InputError(
            f"{given.place('parts')} is {parts!r}; give a list of parts, each with a sensor and a "
            "layout."
        )
    return ScannerText(
        name=given.text("name", default_name) or default_name,
        description=given.text("description", ""),
        source=given.text("source", ""),
        parts=tuple(_part(plain, f"{where}: parts[{i}]") for i, plain in enumerate(parts)),
        robot_radius=_robot_radius(given),
    )


def _robot_radius(given: Fields) -> float | None:
    if "robot_radius" not in given:
        return None
    radius = given.number("robot_radius")
    if radius <= 0.0:
        raise InputError(
            f"{given.place('robot_radius')} is {radius:g}; give metres above zero, e.g. 0.2."
        )
    return radius


def _part(plain: object, where: str) -> Part:
    given = Fields(plain, where, ("sensor", *KINDS))
    sensor = given.raw("sensor")
    if not isinstance(sensor, str):
        made = RangeSensor.from_plain(sensor, given.place("sensor"))
        return Part(made, layout_from_plain(given))
    try:
        preset = PRESETS.get(sensor)
    except InputError as error:
        raise InputError(f"{given.place('sensor')}: {error}") from error
    kinds = {part.sensor for part in parse_scanner(preset.yaml, preset.origin, sensor).parts}
    if len(kinds) != 1:
        raise InputError(
            f"{given.place('sensor')}: the preset {sensor!r} has {len(kinds)} kinds of sensor; "
            "name one that has a single kind."
        )
    return Part(kinds.pop(), layout_from_plain(given))


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
