"""Localizer that navigates by reflectors alone, as a registry entry; walls mean nothing to it.

It is a Kalman filter that moves along with odometry and takes in range and bearing of each
reflector that it recognises (`ambinav.localization.reflector_update`): one or two help as well.
Without any it is dead reckoning, and its covariance grows. It needs to know about where it starts
and does not look for itself again once it is lost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ambinav.casting.scans import plane_only
from ambinav.config import NonNegative, Positive, Share, check_fields
from ambinav.drive.localizer_spec import LocalizerContext, LocalizerSpec
from ambinav.drive.localizers import DeadReckoning, Localizer
from ambinav.geometry.environment import Environment
from ambinav.layers.reflectors.targets import Targets
from ambinav.layers.reflectors.views import ReflectorRules, seen_reflectors, why_no_reflectors
from ambinav.localization.information import as_map_std, beam_noise
from ambinav.localization.intensity import beside_ranges
from ambinav.localization.reflector_detection import reflector_beams
from ambinav.localization.reflector_update import update_by_reflectors
from ambinav.localization.reflector_view import ReflectorMap
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner


@dataclass(frozen=True)
class ReflectorParameters:
    """Parameters of a localizer by reflectors.

    Attributes:
        max_range: Range up to which reflectors are recognised, metres; None: the sensor's.
        max_incidence: Angle to a flat reflector's normal up to which it is recognised, degrees.
        map_std: Standard deviation of a reflector's place, metres; None: `Environment.map_std`.
        confidence: Share of the true matches that the gate lets pass, below 1. A wrong heading
            moves all reflectors at once: a narrow gate would keep out all true matches together.

    Raises:
        InputError: a value makes no sense.
    """

    max_range: Positive | None = None
    max_incidence: Positive = 45.0
    map_std: NonNegative | None = None
    confidence: Share = 0.99999

    def __post_init__(self) -> None:
        """Check what the localizer would otherwise only check when it is made."""
        check_fields(self)
        if not 0.0 < self.confidence < 1.0:
            raise InputError(f"confidence is {self.confidence:g}; give a share between 0 and 1.")
        _ = self.rules

    @property
    def rules(self) -> ReflectorRules:
        """Rules by which reflectors are in view."""
        return ReflectorRules(max_range=self.max_range, max_incidence=self.max_incidence)


class ReflectorLocalizer(DeadReckoning):
    """Kalman filter on ranges and bearings of reflectors, of any number of runs.

    Args:
        parameters: Its parameters.
        context: Map, scanner and odometry.

    Raises:
        InputError: see `check_reflectors`.
    """

    def __init__(self, parameters: ReflectorParameters, context: LocalizerContext) -> None:
        super().__init__(context.noise, context.runs)
        environment, scanner = context.environment, context.scanner
        check_reflectors(environment, scanner)
        self._environment, self._scanner, self._rules = environment, scanner, parameters.rules
        self._targets = Targets.of(environment)
        self._map = ReflectorMap(
            self._targets.edges,
            self._targets.first,
            as_map_std(environment, parameters.map_std) ** 2,
            # Quantile of chi-square with two degrees of freedom.
            -2.0 * math.log1p(-parameters.confidence),
            reflector_beams(scanner),
            beam_noise(environment, scanner, 0.0),
        )

    @property
    def reads_intensities(self) -> bool:
        """True: it recognises reflectors by them."""
        return True

    def update(
        self, odometry: Floats, ranges: Floats32, intensities: Floats32 | None = None
    ) -> Bools:
        """Move along with odometry poses, (R, 3), and use the reflectors of a scan, (R, B) each.

        Returns:
            Which runs used at least one reflector, bool, shape (R,).

        Raises:
            InputError: there are no intensities, or their shape is not that of the ranges.
        """
        read = beside_ranges(self._map, intensities, ranges)
        super().update(odometry, ranges)
        seen = seen_reflectors(
            self._environment, self._scanner, self._targets, self._mean, self._rules
        )
        used = np.empty(len(seen), dtype=np.int64)
        update_by_reflectors(self._mean, self._covariance, ranges, read, seen, self._map, used)
        return used > 0


def check_reflectors(environment: Environment, scanner: RangeScanner) -> None:
    """Check that a scanner can recognise reflectors in a building.

    Raises:
        InputError: the building has none, or is one in space; the scanner measures no intensities.
    """
    plane_only(environment, "navigation by reflectors")
    reason = why_no_reflectors(scanner)
    if reason is not None:
        raise InputError(f"scanner {scanner.name!r} recognises no reflectors: {reason}")
    if not environment.has_reflectors:
        raise InputError(
            f"{environment.name}: it has no reflectors, and the localizer 'reflectors' knows "
            "nothing else; add features of the kind 'reflector' (docs/howto/reflectors.md), or "
            "choose another localizer."
        )


def _made(parameters: ReflectorParameters, context: LocalizerContext) -> Localizer:
    return ReflectorLocalizer(parameters, context)


REFLECTORS = LocalizerSpec(
    name="reflectors",
    title="a Kalman filter on reflectors alone",
    make=_made,
    parameters=ReflectorParameters,
    check=check_reflectors,
)
"""Navigation by reflectors alone."""
