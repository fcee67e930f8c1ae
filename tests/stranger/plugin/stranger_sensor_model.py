"""A sensor model: a stereo camera, whose error grows with the square of the distance."""

from dataclasses import dataclass

from ambinav import Polynomial, RangeSensor
from ambinav.plugin import Positive, SensorModel, check_fields


@dataclass(frozen=True)
class Stereo:
    """What a scanner file may say of it: metres, pixels."""

    max_range: Positive
    baseline: Positive
    focal_length: Positive
    disparity_std: Positive = 0.1

    def __post_init__(self):
        check_fields(self)


def make(stereo):
    """The sensor: an error of `disparity_std` pixels is one of so many metres."""
    squared = stereo.disparity_std / (stereo.focal_length * stereo.baseline)
    return RangeSensor(
        name="stereo",
        max_range=stereo.max_range,
        resolution=0.01,
        std=Polynomial((0.0, 0.0, squared)),
    )


MODEL = SensorModel(name="stereo", title="a stereo camera", parameters=Stereo, make=make)
