"""The localizer of a scenario: Monte Carlo, the extended Kalman filter, or one by name alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from ambinav.config import NonNegative, Positive, check_fields, from_mapping, nearest
from ambinav.drive.localizers import Localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.errors import InputError
from ambinav.geometry.environment import Environment
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.localization.scanner_settings import settings_for, unsuited
from ambinav.sensing.scanner import RangeScanner

SIMPLE: Final = ("perfect", "odometry")
"""Localizers without parameters; see `ambinav.drive.drive`."""

MCL, AMCL = "mcl", "amcl"
"""Monte Carlo localization: with what suits the scanner, and as AMCL has it for any."""

TYPES: Final = (MCL, AMCL, "ekf", *SIMPLE)


@dataclass(frozen=True)
class EkfParameters:
    """Parameters of `ExtendedKalmanFilter`, which takes in every scan.

    Attributes:
        alpha1: See `OdometryModel`, as the other four.
        alpha2: See there.
        alpha3: See there.
        alpha4: See there.
        alpha5: See there.
        map_std: Deviation of the map's walls, metres; None: `Environment.map_std`.
        gate: Beams that are off by more than so many deviations are left out.

    Raises:
        InputError: a value makes no sense.
    """

    alpha1: NonNegative = 0.2
    alpha2: NonNegative = 0.2
    alpha3: NonNegative = 0.2
    alpha4: NonNegative = 0.2
    alpha5: NonNegative = 0.2
    map_std: NonNegative | None = None
    gate: Positive = 3.0

    def __post_init__(self) -> None:
        """Check what the filter would refuse only when it is made."""
        check_fields(self)

    @property
    def odometry(self) -> OdometryModel:
        """The odometry model of alpha1 to alpha5."""
        return OdometryModel(**{key: getattr(self, key) for key in ALPHAS})


Guide = MclParameters | EkfParameters | str


def guide_of(
    plain: Mapping[str, Any] | str, noise: OdometryNoise, robot: Robot, rate: float
) -> Guide:
    """The localizer that a scenario asks for.

    Args:
        plain: A name, or a mapping with the key type ("mcl" if it lacks) and parameters. Alphas
            that it leaves out are those of the simulated odometry, all else as AMCL has it; see
            `suited`.
        noise: The simulated odometry. Monte Carlo localization is told its variances after as
            much motion as it updates by (`OdometryNoise.modelled`), the Kalman filter, which takes
            in every scan, those between two scans at the robot's largest speed.
        robot: The robot that drives.
        rate: Scans a second.

    Raises:
        InputError: the type or a parameter is unknown, or a value makes no sense.
    """
    told = {"type": plain} if isinstance(plain, str) else dict(plain)
    kind = told.pop("type", MCL)
    if kind not in TYPES:
        raise InputError(f"type is {kind!r}; {nearest(str(kind), TYPES)}")
    if kind in SIMPLE:
        if told:
            raise InputError(f"{next(iter(told))} means nothing to the localizer {kind!r}; drop it")
        return str(kind)
    model = noise.modelled
    if kind == "ekf":
        model = noise.modelled_every(robot.max_speed / rate, robot.max_turn_rate / rate)
    alphas = {name: getattr(model, name) for name in ALPHAS if name != "alpha5"}
    told = {**alphas, **told}
    return from_mapping(EkfParameters, told) if kind == "ekf" else MclParameters.from_dict(told)


def suited(plain: Mapping[str, Any] | str, scanner: RangeScanner) -> dict[str, Any] | str:
    """What a scenario says of its localizer, with what it leaves out as the scanner wants it.

    That is for the type mcl; the others are the same for all scanners.
    """
    told = {"type": plain} if isinstance(plain, str) else dict(plain)
    if told.get("type", MCL) != MCL:
        return plain if isinstance(plain, str) else told
    return {**settings_for(scanner, told.get("laser_model_type")), **told}


def name_of(guide: Guide) -> str:
    """The localizer in words, as reports name it."""
    if isinstance(guide, str):
        return {"perfect": "the truth", "odometry": "dead reckoning"}[guide]
    if isinstance(guide, EkfParameters):
        return "a Kalman filter on the ranges of every scan"
    model = guide.laser_model_type
    power = "" if not model.endswith("_prob") else f" to the power {guide.importance_factor:g}"
    return f"Monte Carlo localization ({model}{power})"


def note_on(guide: Guide, scanner: RangeScanner) -> str | None:
    """One sentence on a localizer that cannot use the scanner; None where it can."""
    if not isinstance(guide, MclParameters):
        return None
    return unsuited(guide.laser_model_type, scanner)


def localizer_of(
    guide: Guide, environment: Environment, scanner: RangeScanner, runs: int
) -> Localizer | MclParameters | str:
    """What `ambinav.drive.drive` takes: a filter that is made for a number of runs, or as it is."""
    if not isinstance(guide, EkfParameters):
        return guide
    from ambinav.localization.ekf import ExtendedKalmanFilter

    return ExtendedKalmanFilter(
        environment,
        scanner,
        guide.odometry,
        runs=runs,
        map_std=guide.map_std,
        gate=guide.gate,
    )
