"""Sensor models, which derive a calibration from a sensor's own figures.

A model is a plug-in's description of a kind of sensor: the error of a stereo camera follows from
its baseline, that of a radar from its bandwidth. It makes a `RangeSensor`, which says in numbers
and curves what the map, the simulation and the localizers need, and which is what maps are stored
with: they can be read where the plug-in is not installed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from ambinav.plugins import Registry


@dataclass(frozen=True, kw_only=True)
class SensorModel:
    """Entry of the registry of sensor models.

    Attributes:
        name: What `model` of a sensor in a scanner file says.
        title: What it is, in a line.
        parameters: A dataclass that checks its values; its fields are what the file may give.
        make: From the parameters to a `RangeSensor`. An error that follows another law than a
            polynomial of the range goes into a `curves.Table`.
    """

    name: str
    title: str
    parameters: type[Any]
    make: Callable[[Any], Any]


SENSOR_MODELS: Final = Registry("sensor model", SensorModel, "ambinav.sensor_models", {})
"""The sensor models; what `RangeSensor` itself takes needs none."""
