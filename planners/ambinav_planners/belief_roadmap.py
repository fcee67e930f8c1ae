"""The belief roadmap: covariances of the whole pose over a graph of motions.

Prentice & Roy (2009, "The belief roadmap: efficient planning in belief space by factoring the
covariance", IJRR 28(11-12)): what the extended Kalman filter does to the covariance along a motion
is worked out once per motion (`ambinav_planners.transfer`), and a search carries covariances from
node to node in one step each (`ambinav_planners.roadmap_search`).

Motion model, our own: an odometry whose errors are white along the way. In the frame of travel,
over a stretch of ds metres and a turn of dt radians, with h = drift^2 ds + turn^2 |dt|,

    along: along^2 ds    across: across^2 ds + h ds^2/3    heading: h    across-heading: h ds/2

the last terms being what a heading that errs evenly along the stretch does to its end, so that on
a straight line it does not matter how finely it is cut. An error of the heading at the start swings
the stretch round it: G = [[1, 0, -dy], [0, 1, dx], [0, 0, 1]] (Thrun, Burgard & Fox 2005,
Probabilistic Robotics, section 5.4). Scans add the map's information, spread evenly: ds metres of
travel hold ds / scan_distance scans. In r2 a pose has no heading of its own, so turns on the spot
between two motions are not counted there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambinav.errors import InputError
from ambinav.geometry.steering import DUBINS
from ambinav.kernels import kernel
from ambinav.threads import run_rows
from ambinav_planners.along import pieces_of, pose_along
from ambinav_planners.graph import MotionGraph
from ambinav_planners.information import Information, information_at
from ambinav_planners.transfer import carried, compose

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class OdometryNoise:
    """What travel adds to the uncertainty, as standard deviations.

    Attributes:
        along: Of the distance, metres per root of a metre.
        across: Sideways, metres per root of a metre.
        drift: Of the heading by travel, radians per root of a metre.
        turn: Of the heading by turning, radians per root of a radian.

    Raises:
        InputError: one of them is negative or not finite.
    """

    along: float = 0.05
    across: float = 0.02
    drift: float = 0.03
    turn: float = 0.05

    def __post_init__(self) -> None:
        for name in ("along", "across", "drift", "turn"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InputError(f"{name} is {value}; give a number of at least 0.")

    @property
    def variances(self) -> tuple[float, float, float, float]:
        """The four squares, in their order."""
        return self.along**2, self.across**2, self.drift**2, self.turn**2


@dataclass(frozen=True, eq=False)
class BeliefRoadmap:
    """A graph of motions, and what each of them does to the covariance of the pose.

    Takes 216 bytes a motion: for roadmaps, not for lattices of millions of motions.

    Attributes:
        graph: The motions.
        carry: float64, shape (E, 3, 3); see `ambinav_planners.transfer`.
        noise: Likewise.
        seen: Likewise.
    """

    graph: MotionGraph
    carry: Floats
    noise: Floats
    seen: Floats

    @classmethod
    def of(
        cls,
        graph: MotionGraph,
        information: Information,
        odometry: OdometryNoise,
        *,
        scan_distance: float = 1.0,
        step: float = 0.25,
    ) -> BeliefRoadmap:
        """Run the filter along every motion, in steps of at most `step` metres.

        Args:
            graph: The motions.
            information: What a scan tells; read at the end of each step.
            odometry: What travel adds.
            scan_distance: Metres of travel from one scan that tells something new to the next.
            step: Metres.

        Raises:
            InputError: the scan distance or the step is not above 0.
        """
        for name, value in (("scan_distance", scan_distance), ("step", step)):
            if not (math.isfinite(value) and value > 0.0):
                raise InputError(f"{name} is {value}; give a number of metres above 0.")
        shape = (len(graph.target), 3, 3)
        carry, noise, seen = np.empty(shape), np.empty(shape), np.empty(shape)
        run_rows(
            _transfers, len(graph.poses), graph.steering.kind, float(graph.steering.radius),
            graph.poses, graph.first, graph.target, graph.length, step, odometry.variances,
            1.0 / scan_distance, information.xx, information.xy, information.yy, information.turn,
            *information.lattice, carry, noise, seen,
        )  # fmt: skip
        return cls(graph, carry, noise, seen)

    def along(self, motions: NDArray[np.intp], covariance: Floats) -> Floats:
        """Covariances at the nodes of a way, shape (motions + 1, 3, 3): metres and radians."""
        out = np.empty((len(motions) + 1, 3, 3))
        out[0] = covariance
        for k, e in enumerate(motions):
            out[k + 1] = carried(self.carry[e], self.noise[e], self.seen[e], out[k])
        return out


@kernel
def _transfers(
    begin, end, kind, radius, poses, first, target, length, step, variances, scans,
    xx, xy, yy, turn, left, low, inverse, carry, noise, seen,
):  # fmt: skip
    for node in range(begin, end):
        for e in range(first[node], first[node + 1]):
            a, b = poses[node], poses[target[e]]
            pieces = pieces_of(kind, radius, a, b)
            longest = min(step, radius) if kind >= DUBINS else step  # turns of a radian at most
            count = max(int(math.ceil(length[e] / longest - 1e-9)), 1)
            ds = length[e] / count
            f, n, o = np.eye(3), np.zeros((3, 3)), np.zeros((3, 3))
            before = pose_along(kind, pieces, length[e], a, b, 0.0)
            for k in range(count):
                after = pose_along(kind, pieces, length[e], a, b, (k + 1) / count)
                jacobian, added = motion_step(before, after, ds, variances)
                f, n, o = compose(f, n, o, jacobian, added, np.zeros((3, 3)))
                told = np.zeros((3, 3))
                p, q, r, t = information_at(
                    after[0], after[1], after[2], xx, xy, yy, turn, left, low, inverse
                )
                told[0, 0], told[0, 1], told[1, 0], told[1, 1], told[2, 2] = p, q, q, r, t
                f, n, o = compose(f, n, o, np.eye(3), np.zeros((3, 3)), told * (ds * scans))
                before = after
            carry[e], noise[e], seen[e] = f, n, o


@kernel
def motion_step(before, after, ds, variances):
    """Jacobian and noise of a short stretch of ds metres between two poses."""
    along, across, drift, turn = variances
    dx, dy = after[0] - before[0], after[1] - before[1]
    turned = abs((after[2] - before[2] + math.pi) % (2.0 * math.pi) - math.pi)
    heading = drift * ds + turn * turned
    jacobian = np.eye(3)
    jacobian[0, 2], jacobian[1, 2] = -dy, dx
    chord = math.hypot(dx, dy)
    c, s = (dx / chord, dy / chord) if chord > 0.0 else (1.0, 0.0)
    forward, sideways = along * ds, across * ds + heading * ds * ds / 3.0
    both = 0.5 * heading * ds
    noise = np.empty((3, 3))
    noise[0, 0] = c * c * forward + s * s * sideways
    noise[0, 1] = noise[1, 0] = c * s * (forward - sideways)
    noise[1, 1] = s * s * forward + c * c * sideways
    noise[0, 2] = noise[2, 0] = -s * both
    noise[1, 2] = noise[2, 1] = c * both
    noise[2, 2] = heading
    return jacobian, noise
