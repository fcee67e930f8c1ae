"""The belief roadmap: covariances of the whole pose over a graph of motions.

Prentice & Roy (2009, "The belief roadmap: efficient planning in belief space by factoring the
covariance", IJRR 28(11-12)): what the extended Kalman filter does to the covariance along a motion
is worked out once per motion (`ambinav_planners.belief.transfer`), and a search propagates
covariances from node to node in one step each (`ambinav_planners.belief.roadmap_search`).

Motion model: the odometry of the robot that is driven, `ambinav.drive.noise.OdometryNoise`, whose
errors are white along the path. In the frame of travel, over a stretch of ds metres and a turn of
dt radians, with h = 2 turn_trans ds + turn_turn |dt|,

    along: trans_trans ds + trans_turn |dt|    across: h ds^2/3
    heading: h                                 across-heading: h ds/2

(`PackedNoise` names the four), the last terms being what a heading that errs evenly along the
stretch does to its end, so that on a straight line it does not matter how finely it is cut. An
error of the heading at the start swings the stretch round it: G = [[1, 0, -dy], [0, 1, dx],
[0, 0, 1]] (Thrun, Burgard & Fox 2005, Probabilistic Robotics, section 5.4). Biases of odometry are
no part of a covariance and are not counted. Scans add the map's information, spread evenly: ds
metres of travel hold ds / scan_distance scans.

In r2 a pose has no heading of its own: the robot looks where it goes, and turns on the spot between
two motions. That adds to the covariance as well (`turn_on_the_spot`), and is counted between any
two motions of a path; how the robot stands at the start is not known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ambinav.config import as_positive
from ambinav.drive.noise import OdometryNoise, PackedNoise
from ambinav.forecasting.information_field import InformationField, information_at
from ambinav.geometry.motion.curves import pieces_of, pose_along
from ambinav.geometry.motion.steering import DUBINS, FACING
from ambinav.runtime.array_types import Floats, Indices
from ambinav.runtime.kernels import kernel
from ambinav.runtime.threads import run_rows
from ambinav_planners.belief.transfer import carried, compose
from ambinav_planners.search.graph import MotionGraph


class TransferArrays(NamedTuple):
    """The arrays of a `BeliefRoadmap` for the kernels; see there."""

    carry: Floats
    noise: Floats
    seen: Floats
    heading: Floats
    odometry: PackedNoise


@dataclass(frozen=True, eq=False)
class BeliefRoadmap:
    """A graph of motions, and the effect of each on the covariance of the pose.

    Takes 224 bytes a motion: for roadmaps, not for lattices of millions of motions.

    Attributes:
        graph: The motions.
        carry: float64, shape (E, 3, 3); see `ambinav_planners.belief.transfer`.
        noise: Likewise.
        seen: Likewise.
        heading: In which each motion is driven where the robot turns on the spot between them,
            float64, shape (E,), radians; zeros where it does not, in all spaces but r2.
        odometry: Noise added by travel.
    """

    graph: MotionGraph
    carry: Floats
    noise: Floats
    seen: Floats
    heading: Floats
    odometry: PackedNoise

    @classmethod
    def of(
        cls,
        graph: MotionGraph,
        information: InformationField,
        odometry: OdometryNoise,
        *,
        scan_distance: float = 1.0,
        step: float = 0.25,
    ) -> BeliefRoadmap:
        """Run the filter along every motion, in steps of at most `step` metres.

        Args:
            graph: The motions.
            information: Information of a scan; read at the end of each step.
            odometry: Noise added by travel.
            scan_distance: Metres of travel from one scan that tells something new to the next.
            step: Metres.

        Raises:
            InputError: the scan distance or the step is not above 0.
        """
        scan_distance = as_positive(scan_distance, "scan_distance", "metres")
        step = as_positive(step, "step", "metres")
        shape = (len(graph.target), 3, 3)
        carry, noise, seen = np.empty(shape), np.empty(shape), np.empty(shape)
        run_rows(
            _transfers, len(graph.poses), graph.steering.kind, float(graph.steering.radius),
            graph.poses, graph.arrays, step, odometry.packed, 1.0 / scan_distance,
            information.fields, *information.lattice, carry, noise, seen,
        )  # fmt: skip
        heading = np.zeros(len(graph.target))
        if graph.steering.kind == FACING:
            path = graph.poses[graph.target, :2] - graph.poses[graph.source, :2]
            heading = np.arctan2(path[:, 1], path[:, 0])
        return cls(graph, carry, noise, seen, heading, odometry.packed)

    @property
    def arrays(self) -> TransferArrays:
        """The effects of the motions, for the kernels."""
        return TransferArrays(self.carry, self.noise, self.seen, self.heading, self.odometry)

    def along(self, motions: Indices, covariance: Floats) -> Floats:
        """Return covariances at a path's nodes, shape (motions + 1, 3, 3): metres and radians.

        At a node the robot has not yet turned to where it goes next.
        """
        out = np.empty((len(motions) + 1, 3, 3))
        out[0] = covariance
        for k, e in enumerate(motions):
            before = out[k].copy()
            if k:
                turn_on_the_spot(
                    before, self.heading[motions[k - 1]], self.heading[e], self.odometry
                )
            out[k + 1] = carried(self.carry[e], self.noise[e], self.seen[e], before)
        return out


@kernel
def _transfers(
    begin, end, kind, radius, poses, graph, step, odometry, scans, fields, left, low, inverse,
    carry, noise, seen,
):  # fmt: skip
    first, target, length = graph
    gained = np.empty((3, 3))
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
                jacobian, added = motion_step(before, after, ds, odometry)
                f, n, o = compose(f, n, o, jacobian, added, np.zeros((3, 3)))
                information_at(after[0], after[1], after[2], fields, left, low, inverse, gained)
                f, n, o = compose(f, n, o, np.eye(3), np.zeros((3, 3)), gained * (ds * scans))
                before = after
            carry[e], noise[e], seen[e] = f, n, o


@kernel
def motion_step(before, after, ds, odometry):
    """Return Jacobian and noise of a short motion of ds metres between two poses."""
    dx, dy = after[0] - before[0], after[1] - before[1]
    turned = abs((after[2] - before[2] + math.pi) % (2.0 * math.pi) - math.pi)
    heading = 2.0 * odometry.turn_trans * ds + odometry.turn_turn * turned
    jacobian = np.eye(3)
    jacobian[0, 2], jacobian[1, 2] = -dy, dx
    chord = math.hypot(dx, dy)
    c, s = (dx / chord, dy / chord) if chord > 0.0 else (1.0, 0.0)
    forward = odometry.trans_trans * ds + odometry.trans_turn * turned
    sideways = heading * ds * ds / 3.0
    both = 0.5 * heading * ds
    noise = np.empty((3, 3))
    noise[0, 0] = c * c * forward + s * s * sideways
    noise[0, 1] = noise[1, 0] = c * s * (forward - sideways)
    noise[1, 1] = s * s * forward + c * c * sideways
    noise[0, 2] = noise[2, 0] = -s * both
    noise[1, 2] = noise[2, 1] = c * both
    noise[2, 2] = heading
    return jacobian, noise


@kernel
def turn_on_the_spot(covariance, start, end, odometry):
    """Add the noise of a turn from one heading to another to a covariance (3, 3), in place.

    The short way round. The robot slips along the heading that it has meanwhile:
    trans_turn |integral of u u^T| with u = (cos, sin).
    """
    turn = (end - start + math.pi) % (2.0 * math.pi) - math.pi
    if turn == 0.0:
        return
    end = start + turn
    swing = 0.25 * (math.sin(2.0 * end) - math.sin(2.0 * start))
    sign = 1.0 if turn > 0.0 else -1.0
    xy = 0.5 * (math.sin(end) ** 2 - math.sin(start) ** 2)
    covariance[0, 0] += odometry.trans_turn * sign * (0.5 * turn + swing)
    covariance[1, 1] += odometry.trans_turn * sign * (0.5 * turn - swing)
    covariance[0, 1] += odometry.trans_turn * sign * xy
    covariance[1, 0] += odometry.trans_turn * sign * xy
    covariance[2, 2] += odometry.turn_turn * abs(turn)
