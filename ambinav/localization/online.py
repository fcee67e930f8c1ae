"""Online localizability: information of the present scan about the pose, despite people.

Source: K. Qian, X. Ma, X. Dai, F. Fang, "Mobile robot self-localization in unstructured
environments based on observation localizability estimation with low-cost laser range-finder and
RGB-D sensors", International Journal of Advanced Robotic Systems 13(5), 2016, and Y. Wang,
W. Chen, J. Wang, H. Wang, "Active global localization based on localizability for mobile robots",
Robotica 2014. Their dynamic localizability matrix is the static one, the Fisher information of the
scan on the map, with the influence of readings that hit people, or whatever else the map does not
hold, taken out.

Our own reading, since we know the idea and not all of their formulas: each beam's part of the
information is multiplied by the probability that its reading z is of the wall that the map
expects, at a range z* with variance s^2, by Bayes' rule with the ray model's mixture (Thrun,
Burgard & Fox 2005, "Probabilistic Robotics", section 6.3):

    F = sum_b w_b g_b g_b^T / s_b^2
    w = z_hit N(z; z*, s^2) / (z_hit N(z; z*, s^2) + z_short p_short(z) + z_rand / max_range)
    p_short(z) = lambda_short exp(-lambda_short z) / (1 - exp(-lambda_short z*))    for z < z*

where Qian et al. ask a detector of people in colour and depth images. g and s are those of
`information.scan_information`, exact on the walls, not differences on a grid. A reading that is
longer than it ought to be (a cupboard is gone) loses its weight as one that is shorter does. A
reading that happens to have the expected length counts, whatever it is of.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import check_kind
from ambinav.geometry.environment import Environment
from ambinav.geometry.principal_axes import principal_axes
from ambinav.localization.casting import cast_tables
from ambinav.localization.dynamic_objects import weighted_informations
from ambinav.localization.information import as_covariances, as_map_std, as_poses, beam_noise
from ambinav.localization.parameters import MclParameters
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.runtime.threads import run_rows
from ambinav.sensing.scanner import RangeScanner

# Default prior covariance of a pose: AMCL's initial covariance.
USUAL_PRIOR = (0.25, 0.25, (math.pi / 12.0) ** 2)


@dataclass(frozen=True, eq=False)
class OnlineLocalizability:
    """Information that N scans of B beams give about their poses.

    Attributes:
        information: Dynamic localizability matrix, about x, y (1 / square metres) and theta
            (1 / square radians), map frame, shape (N, 3, 3).
        covariance: What the scan leaves of the prior, (prior^-1 + information)^-1, shape
            (N, 3, 3), square metres and radians.
        weights: Probability that a reading is of the map, shape (N, B): 0 where an echo is
            expected and there was none, nan where there is no reading or the map expects none.
    """

    information: Floats
    covariance: Floats
    weights: Floats

    @property
    def index(self) -> Floats:
        """Determinant of the information, 1 / (m^4 rad^2), shape (N,)."""
        # Rounding may bring that of a singular matrix below 0.
        return np.asarray(np.maximum(np.linalg.det(self.information), 0.0))

    @property
    def radii(self) -> tuple[Floats, Floats, Floats]:
        """Deviations of the position by `covariance`: largest, smallest, and the first's direction.

        Metres, metres, and radians in [0, pi), map frame; each of shape (N,).
        """
        c = self.covariance
        return principal_axes(c[:, 0, 0], c[:, 0, 1], c[:, 1, 1])

    @property
    def explained(self) -> Floats:
        """Share of the expected echoes that the map explains, shape (N,); nan without any."""
        finite = np.isfinite(self.weights)
        number = finite.sum(axis=1)
        total = np.where(finite, self.weights, 0.0).sum(axis=1)
        shares = np.full(len(total), np.nan)
        np.divide(total, number, out=shares, where=number > 0)
        return shares


def online_localizability(
    environment: Environment,
    scanner: RangeScanner,
    poses: ArrayLike,
    ranges: ArrayLike,
    *,
    prior: ArrayLike | None = None,
    uncertainty: ArrayLike | None = None,
    parameters: MclParameters | None = None,
    map_std: float | None = None,
) -> OnlineLocalizability:
    """Compute the localizability of actual scans at estimated poses.

    Args:
        environment: The map.
        scanner: The scanner.
        poses: Where the scans were made as far as is known: x, y, theta, shape (N, 3) or (3,).
        ranges: Readings, shape (N, B), or (B,) for one pose: metres, inf no echo, -inf too near,
            nan no reading.
        prior: Covariance of the pose without the scan, such as odometry has left it, shape (3, 3)
            or (N, 3, 3); None: 0.5 m along x and y, 15 degrees.
        uncertainty: Covariance of `poses` themselves, of the same shapes: readings that differ
            from the expected by no more than the pose may be off keep their weight. None: the
            poses are right.
        parameters: For z_hit, z_short, z_rand and lambda_short; None: AMCL's.
        map_std: As for `information.scan_information`.

    Raises:
        InputError: a shape does not fit, a value is not finite, or a covariance is none.
    """
    check_kind(environment, Environment, "environment")
    check_kind(scanner, RangeScanner, "scanner")
    check_kind(parameters, (MclParameters, NoneType), "parameters")
    rows = as_poses(poses, "poses")
    readings = np.ascontiguousarray(np.atleast_2d(np.asarray(ranges, dtype=np.float64)))
    if readings.shape != (len(rows), scanner.beams):
        raise InputError(
            f"ranges have the shape {readings.shape}; give {(len(rows), scanner.beams)}: the "
            f"{scanner.beams} beams of scanner {scanner.name!r} for each of {len(rows)} poses."
        )
    usual = np.diag(USUAL_PRIOR)
    before = as_covariances(usual if prior is None else prior, "prior", len(rows))
    unsure = np.zeros((3, 3)) if uncertainty is None else uncertainty
    spreads = as_covariances(unsure, "uncertainty", len(rows))
    p = MclParameters() if parameters is None else parameters
    cast = cast_tables(environment, scanner, np.arange(scanner.beams))
    noise = beam_noise(environment, scanner, as_map_std(environment, map_std))
    weights, information = np.empty(readings.shape), np.empty((len(rows), 3, 3))
    run_rows(
        weighted_informations, len(rows), rows, readings, spreads, p.z_hit, p.z_short, p.z_rand,
        p.lambda_short, cast, noise, weights, information, least=16,
    )  # fmt: skip
    return OnlineLocalizability(information, posteriors(before, information), weights)


def posteriors(prior: Floats, information: Floats) -> Floats:
    """Return covariances (prior^-1 + information)^-1, (N, 3, 3); a prior may be singular."""
    new = prior @ np.linalg.inv(np.eye(3) + information @ prior)
    return np.asarray((new + new.swapaxes(-1, -2)) / 2.0)
