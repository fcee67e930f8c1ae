"""The localizers of the studies, by name.

- `product`: Monte Carlo localization that multiplies the beams' likelihoods (power 0.3): of the
  likelihood field for lasers, of the ray model with cones where any sensor has one.
- `rays`: the same with the ray model for lasers too.
- `sum`: Monte Carlo localization that adds the cubes of the same likelihoods (with cones and
  hits of 0.2 m, what the claim was first driven with).
- `amcl`: AMCL's defaults; the likelihood field and sums of cubes, whatever the scanner.
- `kalman`: an extended Kalman filter on the ranges.

All are told how odometry errs, and take a scan in after 0.25 m or 0.2 rad.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ambinav.drive.localizers import Localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.environment import Environment
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.sensing.scanner import RangeScanner

LOCALIZERS = ("product", "kalman", "rays", "sum", "amcl")
WHAT = {
    "product": "Monte Carlo localization, beams multiplied (power 0.3)",
    "rays": "Monte Carlo localization, ray model for lasers too, beams multiplied (power 0.3)",
    "sum": "Monte Carlo localization, cubes of the beams added",
    "amcl": "Monte Carlo localization with AMCL's defaults",
    "kalman": "extended Kalman filter",
}
FIELD = {"importance_factor": 0.3, "sigma_hit": 0.1}
RAYS = {
    "z_hit": 0.7, "z_max": 0.2, "z_short": 0.05, "z_rand": 0.05, "beam_table_resolution": 0.1,
}  # fmt: skip
FIELD_PRODUCT = {**FIELD, "laser_model_type": "likelihood_field_prob"}
FIELD_SUM = {**FIELD, "laser_model_type": "likelihood_field"}
RAY_PRODUCT = {**RAYS, **FIELD, "laser_model_type": "beam_prob"}
RAY_SUM = {**RAYS, "laser_model_type": "beam"}

Floats = NDArray[np.float64]


def has_cones(scanner: RangeScanner) -> bool:
    """Whether any sensor of the scanner is a cone."""
    return any(sensor.aperture > 0.0 for sensor in scanner.sensors)


def parameters_of(name: str, scanner: RangeScanner, noise: OdometryNoise) -> MclParameters:
    """Those of the Monte Carlo localizers among `LOCALIZERS`."""
    cones = has_cones(scanner)
    chosen = {
        "product": RAY_PRODUCT if cones else FIELD_PRODUCT,
        "rays": RAY_PRODUCT,
        "sum": RAY_SUM if cones else FIELD_SUM,
        "amcl": {},
    }[name]
    return MclParameters.from_dict({**chosen, **alphas_of(noise)})


def alphas_of(noise: OdometryNoise) -> dict[str, float]:
    """What a localizer is told of odometry that errs so."""
    return {key: getattr(noise, key) * noise.scale**2 for key in ALPHAS if key != "alpha5"}


def localizer_of(
    name: str, environment: Environment, scanner: RangeScanner, noise: OdometryNoise, runs: int
) -> MclParameters | Localizer:
    """One of `LOCALIZERS`, as `drive` takes it."""
    if name == "kalman":
        return KalmanLocalizer(environment, scanner, OdometryModel(**alphas_of(noise)), runs)
    return parameters_of(name, scanner, noise)


class KalmanLocalizer:
    """Kalman filters that take scans in as seldom as Monte Carlo localization does.

    The variances of AMCL's model are those of motions of `distance` or `angle`; a filter that
    took in every scan would believe in an odometry several times as good.

    Args:
        environment: The map.
        scanner: What the robots see with.
        odometry: What is known of the odometry.
        runs: R.
        distance: A scan is taken in after so many metres,
        angle: or radians.
    """

    def __init__(
        self,
        environment: Environment,
        scanner: RangeScanner,
        odometry: OdometryModel,
        runs: int,
        distance: float = 0.25,
        angle: float = 0.2,
    ) -> None:
        self._model, self._distance, self._angle = odometry, distance, angle
        self._filters = [ExtendedKalmanFilter(environment, scanner, odometry) for _ in range(runs)]
        self._then: Floats | None = None
        self._mean_then = self._mean = np.zeros((runs, 3))
        self._covariance_then = self._covariance = np.zeros((runs, 3, 3))

    @property
    def mean(self) -> Floats:
        """Estimated poses, shape (R, 3)."""
        return self._mean

    @property
    def covariance(self) -> Floats:
        """Their covariances, shape (R, 3, 3)."""
        return self._covariance

    def start(self, poses: Floats, covariance: Floats) -> None:
        """Begin at poses, shape (R, 3), known to a covariance, shape (3, 3)."""
        for one, pose in zip(self._filters, poses, strict=True):
            one.start(pose, covariance)
        self._then = None
        self._mean_then = np.array(poses)
        self._covariance_then = np.tile(covariance, (len(poses), 1, 1))

    def update(self, odometry: Floats, ranges: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Move along with odometry poses, shape (R, 3); take the readings in where it is time.

        Returns:
            Where it was, bool, shape (R,).
        """
        due = np.ones(len(odometry), dtype=np.bool_)
        if self._then is None:
            self._then = odometry.copy()
        else:
            move = odometry - self._then
            turn = np.abs((move[:, 2] + np.pi) % (2.0 * np.pi) - np.pi)
            due = (np.hypot(move[:, 0], move[:, 1]) >= self._distance) | (turn >= self._angle)
        for run in np.flatnonzero(due):
            one = self._filters[run]
            one.update(odometry[run], ranges[run])
            self._mean_then[run], self._covariance_then[run] = one.mean[0], one.covariance[0]
            self._then[run] = odometry[run]
        moved = (self._mean_then, self._then, odometry)
        self._mean = self._model.moved(*moved)
        self._covariance = self._model.covariances(moved[0], self._covariance_then, *moved[1:])
        return due
