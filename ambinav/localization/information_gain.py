"""Expected information gain on a map: how much a drive's scans will tell about its poses.

Kollar & Roy (2008, "Efficient optimization of information-theoretic exploration in SLAM", AAAI),
who search for tours of minimum entropy, Makarenko, Williams, Bourgault & Durrant-Whyte (2002, "An
experiment in integrated exploration", IROS) and Stachniss, Grisetti & Burgard (2005, "Information
gain-based exploration using Rao-Blackwellized particle filters", RSS) choose where a robot goes by
the entropy that a trajectory is expected to take away. They are about mapping and exploration; here
the map is known and the entropy is that of the pose, after Kollar and Roy of a normal distribution
that a Kalman filter carries along the trajectory, with the expected information of its scans:

    H(P) = 1/2 ln det(2 pi e P),    gain of scan k = H(P_k before) - H(P_k after)

Summed over the scans that is the mutual information between all of them and the whole trajectory,
since a scan depends on no other pose than its own (the chain rule of mutual information).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import check_kind, nearest
from ambinav.geometry.environment import Environment
from ambinav.localization.ekf import ExtendedKalmanFilter
from ambinav.localization.expected_covariance import place_and_scanner, walls_std
from ambinav.localization.information import as_covariances, as_poses
from ambinav.localization.odometry import OdometryModel
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

UNITS = {"bits": math.log(2.0), "nats": 1.0}


@dataclass(frozen=True, eq=False)
class InformationGain:
    """Expected information of the scans of a trajectory of N poses.

    Attributes:
        gain: Gain of each scan, given those before it, shape (N,), in `unit`; at least 0.
        covariance: Covariance of each pose after its scan, shape (N, 3, 3), square metres and
            radians.
        without: Covariance of each pose had no scan been made, by odometry alone, shape (N, 3, 3).
        unit: "bits" or "nats".
    """

    gain: Floats
    covariance: Floats
    without: Floats
    unit: str

    @property
    def total(self) -> float:
        """Mutual information of all scans and the whole trajectory, in `unit`."""
        return float(self.gain.sum())

    @property
    def at_goal(self) -> float:
        """Information about the last pose from all scans, in `unit`."""
        difference = np.linalg.slogdet(self.without[-1])[1]
        difference -= np.linalg.slogdet(self.covariance[-1])[1]
        return float(difference) / 2.0 / UNITS[self.unit]


def information_gain(
    place: AmbiguityMap | Environment,
    scanner: RangeScanner | None,
    poses: ArrayLike,
    prior: ArrayLike,
    odometry: OdometryModel | None = None,
    *,
    seen: ArrayLike | None = None,
    map_std: float | None = None,
    unit: str = "bits",
) -> InformationGain:
    """Compute the expected information gain of a trajectory.

    Args:
        place: An environment, or a map of ambiguity, of which the environment is taken.
        scanner: The scanner; None: the map's own.
        poses: Along the trajectory, as far apart as the scans: x, y, theta, shape (N, 3).
        prior: Covariance of the first pose before its scan, shape (3, 3), positive definite.
        odometry: Errors of the odometry between the poses; None: AMCL's defaults.
        seen: True where a scan is made, bool, shape (N,); None: at all poses.
        map_std: As for `expected.expected_covariance`.
        unit: "bits" or "nats".

    Raises:
        InputError: an argument cannot be used.
    """
    if unit not in UNITS:
        raise InputError(f"unit is {unit!r}; {nearest(str(unit), tuple(UNITS))}.")
    rows = as_poses(poses, "poses")
    if not len(rows):
        raise InputError("poses is empty; give at least one.")
    first = as_covariances(prior, "prior", 1)[0]
    least = np.linalg.eigvalsh(first)[0]
    if not least > 0.0:
        raise InputError(
            f"prior has the eigenvalue {least:g}, so that its entropy is not finite; give more "
            "than 0."
        )
    environment, scanner = place_and_scanner(place, scanner)
    check_kind(odometry, (OdometryModel, NoneType), "odometry")
    map_std = walls_std(place, map_std)
    ekf = ExtendedKalmanFilter(environment, scanner, odometry, map_std=map_std)
    after = ekf.predicted_covariances(rows, first, seen)
    without = ekf.predicted_covariances(rows, first, np.zeros(len(rows), dtype=np.bool_))
    # Before each scan: one motion on from after the scan before.
    ahead = ekf.odometry.covariances(rows[:-1], after[:-1], rows[:-1], rows[1:])
    before = np.concatenate([first[np.newaxis], ahead])
    gain = (np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1]) / 2.0 / UNITS[unit]
    return InformationGain(np.maximum(gain, 0.0), after, without, unit)
