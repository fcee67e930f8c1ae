"""YAML form of a sensor: a mapping of its fields, angles in degrees.

name: my sonar
source: where the figures come from
aperture_deg: 30            # full cone; 0 (the default) is a laser
min_range: 0.15             # metres, like all lengths; default 0
max_range: 5.0
resolution: 0.01
bias: 0.0                   # or {polynomial: [...]} or {table: {range: [...], value: [...]}}
std: {polynomial: [0.002, 0.005]}
max_incidence_deg: 25       # left out: every angle returns an echo
random_share: 0.01          # the default
lost_share: 0.0             # the default
intensity: {wall: 0.3, reflector: 1.0, std: 0.15}     # left out: no such channel (`Intensity`)

Or, of a model that a plug-in brings, its name and its own fields (`sensor_models`):

model: stereo
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import InstanceOf

from ambinav.config import ConfigModel, Degrees, Number, Text, as_degrees, checked, of_mapping
from ambinav.sensing import curves
from ambinav.sensing.intensity import Intensity


class _SensorModel(ConfigModel):
    """Fields of a sensor's file; `RangeSensor` checks the limits and the curves."""

    name: Text = ""
    source: Text = ""
    aperture_deg: Degrees = 0.0
    min_range: Number = 0.0
    max_range: Number
    resolution: Number
    bias: Any = 0.0
    std: Any
    max_incidence_deg: Degrees | None = None
    random_share: Number = 0.01
    lost_share: Number = 0.0
    intensity: Annotated[InstanceOf[Intensity], of_mapping(Intensity)] | None = None


def parse_sensor(plain: object, where: str) -> dict[str, Any]:
    """Return `RangeSensor` arguments from parsed YAML; `where` names it in messages.

    Raises:
        InputError: a field is unknown, missing or of the wrong type.
    """
    model = checked(_SensorModel, plain, where)
    return {key.removesuffix("_deg"): value for key, value in model}


def render_sensor(fields: Mapping[str, Any]) -> dict[str, object]:
    """Return the YAML form of a sensor as a mapping; empty texts are left out.

    Args:
        fields: The arguments of `RangeSensor`, as `parse_sensor` gives them.
    """
    plain: dict[str, object] = {
        "name": fields["name"],
        "source": fields["source"],
        "aperture_deg": as_degrees(fields["aperture"]),
        "min_range": fields["min_range"],
        "max_range": fields["max_range"],
        "resolution": fields["resolution"],
        "bias": curves.to_plain(fields["bias"]),
        "std": curves.to_plain(fields["std"]),
        "random_share": fields["random_share"],
        "lost_share": fields["lost_share"],
    }
    if fields["max_incidence"] is not None:
        plain["max_incidence_deg"] = as_degrees(fields["max_incidence"])
    if fields["intensity"] is not None:
        plain["intensity"] = fields["intensity"].to_plain()
    return {key: value for key, value in plain.items() if value != ""}
