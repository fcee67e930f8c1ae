"""A localizer: dead reckoning that always claims the same deviation."""

from dataclasses import dataclass

import numpy as np

from ambinav import InputError
from ambinav.plugin import LocalizerSpec, as_number, compose_motion


@dataclass(frozen=True)
class Parameters:
    """What a scenario may say of it: the claimed deviation, metres and radians."""

    std: float = 0.1

    def __post_init__(self):
        if as_number(self.std, "std") < 0.0:
            raise InputError(f"std is {self.std}; give at least 0.")


class Confident:
    """Estimates of R runs at once."""

    def __init__(self, parameters, context):
        self._square = parameters.std**2
        self.mean = np.zeros((context.runs, 3))

    @property
    def covariance(self):
        return np.tile(self._square * np.eye(3), (len(self.mean), 1, 1))

    def start(self, poses, covariance):
        self.mean, self._odometry = np.array(poses), None

    def update(self, odometry, ranges):
        if self._odometry is not None:
            self.mean = compose_motion(self.mean, self._odometry, odometry)
        self._odometry = odometry.copy()
        return np.ones(len(odometry), dtype=bool)


LOCALIZER = LocalizerSpec(
    name="confident",
    title="dead reckoning that is sure of itself",
    make=Confident,
    parameters=Parameters,
)
