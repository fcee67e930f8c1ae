"""A part of the observation: the nearest reading."""

from ambinav_envs.plugin import ObservationPart


def nearest(seen):
    """The nearest reading of each robot, shape (n, 1)."""
    return seen.readings.min(axis=1, keepdims=True).clip(0.0, 4.0)


PART = ObservationPart(
    name="nearest",
    unit="m",
    meaning="the nearest reading, at most 4 m",
    size=lambda parameters: 1,
    low=0.0,
    high=4.0,
    function=nearest,
)
