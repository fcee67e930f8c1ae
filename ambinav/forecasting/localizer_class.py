"""Classes of localizers: how much of a scan's information each gains, and how sure it may be.

The filter of a forecast knows what a scan tells an ideal localizer. How much of it a class of
localizers gains, and how its raw lost shares relate to what robots do, was fitted to drives in many
buildings (docs/forecast.md); each class is a file with the date, the commit and the spread of the
fit. Ours are one YAML file each, in the folder `localizers` beside this.
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
import yaml
from scipy.special import expit

from ambinav.config import Number, Positive, check_fields, check_kind, nearest, read_text
from ambinav.config.files import parse_yaml
from ambinav.config.model import from_mapping, of_mapping
from ambinav.drive.localizer_spec import (
    DEFAULT,
    LOCALIZERS,
    ChosenLocalizer,
    chosen_localizer,
    suited,
)
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.forecasting.filter_kernel import FilterSettings
from ambinav.forecasting.reliability import ReliabilityBin
from ambinav.localization.parameters import MclParameters
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.sensing.scanner import RangeScanner

Plain = str | Mapping[str, Any]

_FOLDER: Final = Path(__file__).parent / "localizers"
_EXAMPLE: Final = "a mapping with name, gain, slope and offset"
ECHO_GAINS: Final = {"likelihood_field_prob": 8000.0, "likelihood_field": 500.0}
"""`LocalizerClass.echo_gain` by the laser's model: with these, forecasts agree with drives where
few beams return an echo (benchmarks/study_few_echoes.py), and elsewhere they fit as well."""
# Probabilities nearer to 0 or 1 count as so near: their log odds are finite.
LEAST_PROBABILITY: Final = 1e-6


@dataclass(frozen=True, kw_only=True)
class LocalizerClass:
    """Calibrated parameters of a class of localizers.

    Attributes:
        name: What `--localizer` calls it.
        title: What reports call it.
        gain: Factor on a scan's information in an update.
        turn_gain: Factor on that about the heading, beside `gain`.
        echo_gain: Of a localizer that passes over beams without an echo, what echoes tell at most:
            the information about a position, 1/m^2, of an update whose beams all end on one wall,
            across it (`InformationField`). None: without an echo a beam tells as much.
        distance: Metres from one update to the next.
        angle: Radians from one update to the next.
        slope: Of the log odds of a lost share, raw to calibrated.
        offset: Added to them.
        skill: Interval of the Brier skill on buildings left out; None: it was not measured.
        localizer: What drives are of, as in a scenario: a name of the registry, or a mapping with
            the key type and parameters. The odometry's parameters follow from the odometry.
        otherwise: Likewise, for scanners that `localizer` cannot use; None: there are none.
        made: Provenance of the fit: date, commit, numbers of buildings and routes, and the Brier
            skill on buildings left out, with its interval.
        reliability: Lost robots on routes in buildings left out, by forecast; (): not measured.

    Raises:
        InputError: a number is out of its range.
    """

    name: str
    title: str
    gain: Positive
    turn_gain: Positive = 1.0
    echo_gain: Positive | None = None
    distance: Positive = 0.25
    angle: Positive = 0.2
    slope: Positive = 1.0
    offset: Number = 0.0
    skill: tuple[Number, Number] | None = None
    localizer: Plain = DEFAULT
    otherwise: Plain | None = None
    made: str = ""
    reliability: tuple[Annotated[ReliabilityBin, of_mapping(ReliabilityBin)], ...] = ()

    def __post_init__(self) -> None:
        check_fields(self, f"localizer {self.name!r}")

    @classmethod
    def load(cls, which: str | Path | LocalizerClass) -> LocalizerClass:
        """Return a class by its name, or from a file.

        Args:
            which: A name of `localizer_classes()`, a YAML file, or a class, which is returned.

        Raises:
            InputError: there is no such class or file, or the file cannot be used.
        """
        if isinstance(which, LocalizerClass):
            return which
        check_kind(which, (str, Path), "localizer", "give a name, a YAML file or a LocalizerClass")
        path = _FOLDER / f"{which}.yaml"
        if not path.is_file() or Path(which).suffix:
            path = Path(which)
            if not path.suffix:
                raise InputError(
                    f"localizer is {str(which)!r}, which has no calibration; "
                    f"{nearest(str(which), localizer_classes())}, or give a file."
                )
        plain: Any = parse_yaml(read_text(path), str(path), _EXAMPLE)
        if not isinstance(plain, Mapping):
            raise InputError(f"{path} holds {reprlib.repr(plain)}; give {_EXAMPLE}.")
        if "type" in plain and "gain" not in plain:
            raise InputError(
                f"{path} is the file of a localizer, and this needs a class, whose forecasts were "
                "fitted to its drives; make a class of it with `ambinav calibrate localizer`."
            )
        try:
            made = from_mapping(cls, plain)
            for localizer in (made.localizer, made.otherwise):
                if localizer is not None:
                    chosen_localizer(localizer, OdometryNoise(), Robot(), 10.0)
            return made
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    def chosen(
        self,
        scanner: RangeScanner,
        odometry: OdometryNoise,
        robot: Robot | None = None,
        rate: float = 10.0,
    ) -> ChosenLocalizer:
        """Return the localizer of the class for a scanner, which knows how the odometry errs.

        Args:
            scanner: The scanner.
            odometry: Errors of the odometry.
            robot: The robot that drives; None: the default one.
            rate: Scans a second.

        Raises:
            InputError: the class names a localizer or a parameter that there is not, or scanner or
                odometry are something else.
        """
        check_kind(scanner, RangeScanner, "scanner")
        check_kind(odometry, OdometryNoise, "odometry")
        motion = odometry, robot or Robot(), rate
        made = chosen_localizer(suited(self.localizer, scanner), *motion)
        if self.otherwise is not None and made.note(scanner) is not None:
            made = chosen_localizer(suited(self.otherwise, scanner), *motion)
        return made

    def limited_by_echoes(self, scanner: RangeScanner) -> bool:
        """Return whether `echo_gain` holds for drives with a scanner: of a likelihood field."""
        if self.echo_gain is None:
            return False
        parameters = self.chosen(scanner, OdometryNoise()).parameters
        return isinstance(parameters, MclParameters) and parameters.laser_model_type.startswith(
            "likelihood_field"
        )

    @property
    def has_skill(self) -> bool:
        """False if forecasts by the class may be no better than the mean lost share."""
        return self.skill is None or self.skill[0] > 0.0

    @property
    def runs_command(self) -> bool:
        """True if its drives start a program that the file names, with the user's rights."""
        plain = [self.localizer] if self.otherwise is None else [self.localizer, self.otherwise]
        names = [entry if isinstance(entry, str) else entry.get("type", DEFAULT) for entry in plain]
        return any(LOCALIZERS.get(name).runs_command for name in names)

    def to_yaml(self, path: Path) -> None:
        """Write the file of the class, numbers with four digits, without fields that are empty.

        Raises:
            InputError: the file cannot be written.
        """
        plain = {
            key: float(f"{value:.4g}") if isinstance(value, float) else value
            for key, value in asdict(self).items()
            if value not in (None, ())
        }
        text = yaml.safe_dump(
            plain, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None
        )
        write_text(path, text)

    def settings(
        self, position_limit: float, heading_limit: float, lateral_limit: float | None = None
    ) -> FilterSettings:
        """Return what the filter's kernels take; limits in metres and radians."""
        across = math.inf if lateral_limit is None else lateral_limit
        return FilterSettings(
            self.gain, self.turn_gain, self.distance, self.angle, position_limit, across,
            heading_limit, math.inf if self.echo_gain is None else self.echo_gain,
        )  # fmt: skip

    def calibrated(self, raw: Floats) -> Floats:
        """Return calibrated probabilities of raw lost shares, any shape; 0 stays 0."""
        odds = self.offset + self.slope * log_odds(raw)
        return np.where(raw > 0.0, expit(odds), 0.0)

    def raw(self, probability: float) -> float:
        """Return the raw lost share whose calibrated probability this is, above 0 and below 1."""
        odds = (float(log_odds(np.array(probability))) - self.offset) / self.slope
        return float(expit(odds))


def log_odds(probabilities: Floats) -> Floats:
    """Return log(p / (1 - p)) with p held within `LEAST_PROBABILITY` of 0 and 1."""
    p = np.clip(probabilities, LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY)
    return np.asarray(np.log(p / (1.0 - p)))


def class_of(
    localizer: ChosenLocalizer,
    scanner: RangeScanner,
    odometry: OdometryNoise,
    robot: Robot,
    rate: float,
) -> LocalizerClass | None:
    """Return the calibrated class that a localizer is of; None if none was calibrated.

    What the localizer is called does not matter: with level lasers "mcl" is "amcl". Of scanners
    that it cannot use no class was calibrated.

    Arguments beside the localizer as of `LocalizerClass.chosen`.
    """
    if localizer.note(scanner) is not None:
        return None
    for name in localizer_classes():
        entry = LocalizerClass.load(name)
        chosen = entry.chosen(scanner, odometry, robot, rate)
        if (chosen.spec.make, chosen.parameters) == (localizer.spec.make, localizer.parameters):
            return entry
    return None


def classes_for(scanner: RangeScanner) -> tuple[LocalizerClass, ...]:
    """Return the calibrated classes that can use a scanner, sorted by name."""
    entries = map(LocalizerClass.load, localizer_classes())
    return tuple(e for e in entries if e.chosen(scanner, OdometryNoise()).note(scanner) is None)


def localizer_classes() -> tuple[str, ...]:
    """Return the names of the calibrated classes, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))
