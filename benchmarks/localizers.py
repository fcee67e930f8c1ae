"""The localizers of the studies, by name.

- `product`: Monte Carlo localization that multiplies the beams' likelihoods (power 0.3): of the
  likelihood field for lasers, of the ray model with cones where any sensor has one.
- `rays`: the same with the ray model for lasers too.
- `sum`: Monte Carlo localization that adds the cubes of the same likelihoods (with cones and
  hits of 0.2 m, what the claim was first driven with).
- `amcl`: AMCL's defaults; the likelihood field and sums of cubes, whatever the scanner.
- `kalman`: an extended Kalman filter on the ranges, which takes in every scan.
- `pfilter`: a particle filter of another project, in a process of its own
  (`examples/outside_localizer`): a likelihood field whose beams are multiplied, 400
  particles, 30 beams.

Monte Carlo localization takes in a scan every 0.25 m or 0.2 rad, at most 60 beams of it, the Kalman
filter all beams of every scan: what the filter does better need not be its method. All know how
odometry errs: Monte Carlo localization as it is after 0.25 m or 0.2 rad; the Kalman filter as it is
in the time between two scans at the robot's speed.
"""

from __future__ import annotations

import sys
from typing import Any

from harness import ROOT

from ambinav.drive.localizer_spec import ChosenLocalizer, chosen_localizer
from ambinav.drive.localizers import Localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.localization.scanner_settings import CONE_PRODUCT, CONE_RAYS, has_cones
from ambinav.sensing.scanner import RangeScanner

ROBOT = Robot(radius=0.105)
"""A TurtleBot3 Burger; what drives in the studies."""
LOCALIZERS = ("product", "kalman", "rays", "sum", "amcl", "pfilter")
MCL_SCANS = "takes in a scan every 0.25 m or 0.2 rad"
WHAT = {
    "product": f"Monte Carlo localization, beams multiplied (power 0.3); {MCL_SCANS}",
    "rays": (
        "Monte Carlo localization, ray model for lasers too, beams multiplied (power 0.3); "
        f"{MCL_SCANS}"
    ),
    "sum": f"Monte Carlo localization, cubes of the beams added; {MCL_SCANS}",
    "amcl": f"Monte Carlo localization with AMCL's defaults; {MCL_SCANS}",
    "kalman": (
        "extended Kalman filter on the ranges; takes in every scan with all of its beams, several "
        "times as much as Monte Carlo localization"
    ),
    "pfilter": f"particle filter of another project, beams multiplied; {MCL_SCANS}",
}
FIELD = {"importance_factor": 0.3, "sigma_hit": 0.1}
FIELD_PRODUCT = {**FIELD, "laser_model_type": "likelihood_field_prob"}
FIELD_SUM = {**FIELD, "laser_model_type": "likelihood_field"}
RAY_SUM = {**CONE_RAYS, "laser_model_type": "beam"}
PFILTER = {
    "type": "program",
    "command": [sys.executable, str(ROOT / "examples/outside_localizer/pfilter_localizer.py")],
}
REGISTERED: dict[str, dict[str, str | dict[str, Any]]] = {
    "product": {"localizer": {"type": "mcl", **FIELD_PRODUCT}, "otherwise": "mcl"},
    "rays": {"localizer": {"type": "mcl", **CONE_PRODUCT}},
    "sum": {"localizer": {"type": "mcl", **FIELD_SUM}, "otherwise": {"type": "mcl", **RAY_SUM}},
    "amcl": {"localizer": "amcl"},
    "kalman": {"localizer": "ekf"},
    "pfilter": {"localizer": PFILTER},
}
"""What each is in the registry of localizers: fields of a `LocalizerClass`."""


def parameters_of(name: str, scanner: RangeScanner, noise: OdometryNoise) -> MclParameters:
    """Return the parameters of the Monte Carlo localizers among `LOCALIZERS`."""
    cones = has_cones(scanner)
    chosen = {
        "product": CONE_PRODUCT if cones else FIELD_PRODUCT,
        "rays": CONE_PRODUCT,
        "sum": RAY_SUM if cones else FIELD_SUM,
        "amcl": {},
    }[name]
    return MclParameters.from_dict({**chosen, **alphas_of(noise)})


def alphas_of(noise: OdometryNoise) -> dict[str, float]:
    """Return the odometry parameters of a localizer that knows the odometry's errors."""
    return {key: getattr(noise.modelled, key) for key in ALPHAS if key != "alpha5"}


def localizer_of(
    name: str,
    environment: Environment,
    scanner: RangeScanner,
    noise: OdometryNoise,
    runs: int,
    rate: float = 10.0,
) -> ChosenLocalizer | MclParameters | Localizer:
    """Return one of `LOCALIZERS`, as `drive_route` takes it, for scans at a rate, 1 / s."""
    if name == "kalman":
        model = between_scans(noise, rate)
        return ExtendedKalmanFilter(environment, scanner, model, runs=runs)
    if name == "pfilter":  # made for each drive, with random numbers of its own
        return chosen_localizer(PFILTER, noise, ROBOT, rate)
    return parameters_of(name, scanner, noise)


def between_scans(noise: OdometryNoise, rate: float) -> OdometryModel:
    """Return AMCL's model with the variances of odometry from scan to scan."""
    return noise.modelled_every(ROBOT.max_speed / rate, ROBOT.max_turn_rate / rate)
