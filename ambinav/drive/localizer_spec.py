"""Registry of localizers, and the choice of one for a scenario or a drive."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from ambinav.config import from_mapping, nearest
from ambinav.drive.localizers import Localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.geometry.environment import Environment
from ambinav.plugins import Calling, Registry
from ambinav.runtime.array_types import Bools, Floats, Floats32, Ints
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

DEFAULT: Final = "mcl"
"""The localizer of a scenario that names none."""


class LocalizerContext(NamedTuple):
    """Arguments with which a localizer is made.

    Attributes:
        environment: The map that it has.
        scanner: What the robot sees with.
        noise: What is known of the odometry's errors.
        runs: How many robots it localizes side by side, R.
        rng: Its source of randomness.
    """

    environment: Environment
    scanner: RangeScanner
    noise: OdometryNoise
    runs: int
    rng: np.random.Generator


class Motion(NamedTuple):
    """Motion of the robot between two scans.

    Attributes:
        noise: The simulated odometry.
        robot: The robot that drives.
        rate: Scans a second.
    """

    noise: OdometryNoise
    robot: Robot
    rate: float


@dataclass(frozen=True)
class NoParameters:
    """Parameters of a localizer that takes none."""


@dataclass(frozen=True, kw_only=True)
class LocalizerSpec:
    """Entry of the registry of localizers.

    Attributes:
        name: What scenario files call it.
        title: What reports call it.
        make: Makes the localizer from its parameters; None: the localizer returns the true pose.
        parameters: A dataclass that checks its values; its fields are what a scenario may give.
        detail: What reports add to the title, of the parameters; "" for nothing.
        defaults: Parameters that the scenario leaves out, as they follow from the odometry.
        suited: Parameters that the scenario leaves out, as they suit the scanner; takes what is
            given too.
        note: One sentence on parameters that cannot use the scanner; None where they can.
        check: Raises `InputError` if it cannot be used in a building or with a scanner.
        files: Files, beside its source, that its estimates depend on.
        runs_command: Whether its parameters name a program that runs with the user's rights.
    """

    name: str
    title: str
    make: Callable[[Any, LocalizerContext], Localizer | None]
    parameters: type[Any] = NoParameters
    detail: Callable[[Any], str] = lambda parameters: ""
    defaults: Callable[[Motion], Mapping[str, Any]] = lambda motion: {}
    suited: Callable[[RangeScanner, Mapping[str, Any]], Mapping[str, Any]] = lambda *given: {}
    note: Callable[[Any, RangeScanner], str | None] = lambda parameters, scanner: None
    check: Callable[[Environment, RangeScanner], None] = lambda environment, scanner: None
    files: Callable[[Any], Iterable[Path]] = lambda parameters: ()
    runs_command: bool = False

    def __reduce__(self) -> tuple[Callable[[str], LocalizerSpec], tuple[str]]:
        """Pickle the name: the entry's functions need not be importable."""
        return _registered, (self.name,)


def _registered(name: str) -> LocalizerSpec:
    return LOCALIZERS.get(name)


LOCALIZERS: Final = Registry(
    "localizer",
    LocalizerSpec,
    "ambinav.localizers",
    {
        "mcl": "ambinav.drive.own_localizers:MCL",
        "amcl": "ambinav.drive.own_localizers:AMCL",
        "ekf": "ambinav.drive.own_localizers:EKF",
        "reflectors": "ambinav.drive.reflector_localizer:REFLECTORS",
        "perfect": "ambinav.drive.own_localizers:PERFECT",
        "odometry": "ambinav.drive.own_localizers:ODOMETRY",
        "program": "ambinav.drive.program_localizer:PROGRAM",
    },
)
"""All localizers. The environments have those of `simulation.layout.LOCALIZERS`, compiled."""


class _Plugged:
    """Localizer of a plug-in; its failures name the plug-in; see `Localizer`."""

    def __init__(self, made: Localizer, calling: Calling) -> None:
        self._made = made
        self._calling = calling

    @property
    def mean(self) -> Floats:
        with self._calling:
            return self._made.mean

    @property
    def covariance(self) -> Floats:
        with self._calling:
            return self._made.covariance

    def start(self, poses: Floats, covariance: Floats) -> None:
        with self._calling:
            self._made.start(poses, covariance)

    def update(self, odometry: Floats, ranges: Floats32) -> Bools | Ints:
        with self._calling:
            return self._made.update(odometry, ranges)


@dataclass(frozen=True)
class ChosenLocalizer:
    """Localizer with its parameters.

    Attributes:
        spec: Which one.
        parameters: An instance of `spec.parameters`.
    """

    spec: LocalizerSpec
    parameters: Any

    @property
    def title(self) -> str:
        """Name of the localizer in reports."""
        with LOCALIZERS.calling(self.spec.name):
            detail = self.spec.detail(self.parameters)
        return f"{self.spec.title} ({detail})" if detail else self.spec.title

    @property
    def plain(self) -> dict[str, Any] | str:
        """Parameters by name; only the name of a localizer that takes none."""
        return dataclasses.asdict(self.parameters) or self.spec.name

    @property
    def identity(self) -> tuple[str, Any, str]:
        """Name, parameters and checksum of its files: all that its estimates depend on."""
        checksum = hashlib.sha256()
        with LOCALIZERS.calling(self.spec.name):
            source = Path(inspect.getfile(self.spec.make))
            for path in (source, *self.spec.files(self.parameters)):
                checksum.update(path.read_bytes())
        return self.spec.name, self.parameters, checksum.hexdigest()

    def note(self, scanner: RangeScanner) -> str | None:
        """Explain why a localizer cannot use the scanner; None if it can."""
        with LOCALIZERS.calling(self.spec.name):
            return self.spec.note(self.parameters, scanner)

    def check(self, environment: Environment, scanner: RangeScanner) -> None:
        """Raise `InputError` if the localizer cannot be used in a building or with a scanner."""
        with LOCALIZERS.calling(self.spec.name):
            self.spec.check(environment, scanner)

    def make(self, context: LocalizerContext) -> Localizer | None:
        """Make the localizer; None means one that returns the true pose.

        Raises:
            InputError: it cannot be made of these parameters, or is a plug-in's and fails.
        """
        calling = LOCALIZERS.calling(self.spec.name)
        with calling:
            made = self.spec.make(self.parameters, context)
        return _Plugged(made, calling) if made is not None and calling.whose else made


def chosen_localizer(
    plain: Mapping[str, Any] | str, noise: OdometryNoise, robot: Robot, rate: float
) -> ChosenLocalizer:
    """Return the localizer that a scenario asks for.

    Args:
        plain: A name, or a mapping with the key type (`DEFAULT` if it lacks) and parameters. What
            it leaves out follows from the odometry (`LocalizerSpec.defaults`); see `suited` too.
        noise: The simulated odometry.
        robot: The robot that drives.
        rate: Scans a second.

    Raises:
        InputError: the type or a parameter is unknown, or a value makes no sense.
    """
    name, given = _split(plain)
    spec = LOCALIZERS.get(name)
    if given and not dataclasses.fields(spec.parameters):
        raise InputError(f"{next(iter(given))} means nothing to the localizer {name!r}; drop it")
    with LOCALIZERS.calling(name):
        values = {**spec.defaults(Motion(noise, robot, rate)), **given}
        return ChosenLocalizer(spec, from_mapping(spec.parameters, values))


def named_localizer(
    name: str, scanner: RangeScanner, noise: OdometryNoise, robot: Robot, rate: float
) -> ChosenLocalizer:
    """Return a localizer by its name, with parameters that suit scanner and odometry.

    Raises:
        InputError: there is none of that name.
    """
    names = LOCALIZERS.names()
    if name not in names:
        raise InputError(
            f"there is no localizer {name!r}; {nearest(name, names)}, or for a class of localizers "
            "give `LocalizerClass.load(NAME).chosen(scanner, noise)`."
        )
    return chosen_localizer(suited(name, scanner), noise, robot, rate)


def suited(plain: Mapping[str, Any] | str, scanner: RangeScanner) -> dict[str, Any] | str:
    """Complete a scenario's localizer with the settings that suit the scanner.

    Raises:
        InputError: the type is unknown.
    """
    name, parameters = _split(plain)
    with LOCALIZERS.calling(name):
        more = dict(LOCALIZERS.get(name).suited(scanner, parameters))
    if not more:
        return plain if isinstance(plain, str) else dict(plain)
    return {"type": name, **more, **parameters}


def _split(plain: Mapping[str, Any] | str) -> tuple[str, dict[str, Any]]:
    """Return name and parameters."""
    parameters = {"type": plain} if isinstance(plain, str) else dict(plain)
    return str(parameters.pop("type", DEFAULT)), parameters
