"""Figures of routes with a scanner: stretches of bad floor and the expected error on them.

The error is that of an extended Kalman filter (`ambinav.localization.ekf`) which updates by a scan
each so many metres, as it follows from the geometry before anybody drives: odometry adds variance
by AMCL's model of motion (Thrun, Burgard & Fox 2005, "Probabilistic Robotics", section 5.4), and a
scan takes some off by its Fisher information (Censi 2007, "On achievable accuracy for range-finder
localization", ICRA), the same that `expected_covariance(..., source="fisher")` is made of. That is
the bound of an ideal localizer which knows where about it is: an order of scanners, no promise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ambinav.drive.noise import OdometryNoise
from ambinav.geometry.collision.checker import CollisionChecker
from ambinav.geometry.environment import Environment
from ambinav.geometry.footprint import Footprint
from ambinav.localization.ekf import covariances_along
from ambinav.localization.information import scan_information
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.routes.bad_floor import BadFloor
from ambinav.routes.evaluate import evaluate_route
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner
from ambinav.service.service import AmbiguityService

SOURCE: Final = (
    "extended Kalman filter with the Fisher information of each scan (Censi 2007) and AMCL's model "
    "of odometry (Thrun, Burgard & Fox 2005)"
)
"""Source of the expected error, for reports."""


@dataclass(frozen=True, kw_only=True)
class ErrorModel:
    """Odometry and localizer of the expected error.

    Attributes:
        odometry: Odometry errors; a scan is taken in each `odometry.distance` metres.
        beams: Number of beams that the localizer uses of a scan, as AMCL's max_beams.
        start_std: Deviation of x, y (metres) and heading (radians) at the start, as in drives.
    """

    odometry: OdometryNoise = field(default_factory=OdometryNoise)
    beams: int = 60
    start_std: tuple[float, float, float] = (0.05, 0.05, 0.02)

    def __post_init__(self) -> None:
        if self.beams < 1:
            raise InputError(f"beams of the localizer: {self.beams} is too few; give 1 or more.")
        if not self.odometry.distance > 0.0:
            raise InputError("odometry: distance is 0; give metres between scans above 0.")

    @property
    def text(self) -> str:
        """Description of the model in a sentence, without a full stop."""
        noise = self.odometry
        return (
            f"a scan of {self.beams} beams every {noise.distance:g} m; odometry with alpha1 to "
            f"alpha4 of {noise.alpha1:g}, {noise.alpha2:g}, {noise.alpha3:g}, {noise.alpha4:g}, "
            f"its errors {noise.scale:g} times these; at the start x and y known to "
            f"{self.start_std[0]:g} m, the heading to {self.start_std[2]:g} rad"
        )


@dataclass(frozen=True)
class RouteFigures:
    """Figures of all routes together.

    Attributes:
        metres: Length of all routes.
        floor: Metres in corridor and in open zones, and the longest stretch in each.
        longest_bad: The longest stretch in either zone, metres.
        mean_error: Expected error of the position, root of the variances of x and y, mean over
            all metres; metres.
        worst_error: The largest of it anywhere.
    """

    metres: float
    floor: BadFloor
    longest_bad: float
    mean_error: float
    worst_error: float


def route_figures(
    amap: AmbiguityMap,
    environment: Environment,
    scanner: RangeScanner,
    routes: Sequence[Route],
    model: ErrorModel,
    map_std: float | None = None,
) -> RouteFigures:
    """Measure routes with a scanner.

    Args:
        amap: The ambiguity map of the building for the scanner.
        environment: The building.
        scanner: The scanner.
        routes: At least one, each longer than 0.
        model: Model of the expected error.
        map_std: Standard deviation of the walls' position, metres; None: the environment's own.

    Raises:
        InputError: a pose lies outside of the map.
    """
    service = AmbiguityService(amap)
    measured = [
        evaluate_route(service, route.poses, route.steering, planner=route.planner)
        for route in routes
    ]
    integral, worst = 0.0, 0.0
    for route in routes:
        error, along = expected_errors(environment, scanner, route, model, map_std)
        integral += float(np.trapezoid(error, along))
        worst = max(worst, float(error.max()))
    metres = sum(route.length for route in measured)
    return RouteFigures(
        metres=metres,
        floor=BadFloor.joined([BadFloor.of(route) for route in measured]),
        longest_bad=max(route.longest_bad for route in measured),
        mean_error=integral / metres,
        worst_error=worst,
    )


def expected_errors(
    environment: Environment,
    scanner: RangeScanner,
    route: Route,
    model: ErrorModel,
    map_std: float | None = None,
) -> tuple[Floats, Floats]:
    """Compute the expected error of the position along a route.

    Args:
        environment: The building.
        scanner: The scanner.
        route: The route.
        model: Odometry and localizer.
        map_std: As in `route_figures`.

    Returns:
        Metres, root of the variances of x and y, after each scan; and metres gone up to there,
        both of shape (N,).
    """
    noise = model.odometry
    dense, _, along = route.steering.dense(route.poses, noise.distance)
    # No position twice: where two motions join, or the robot turns on the spot, it scans once.
    moved = np.diff(along, prepend=-1.0) > 0.0
    thinned = scanner.thinned(max(model.beams, len(scanner.parts)))
    start = np.diag(np.square(model.start_std))
    scans = scan_information(environment, thinned, dense[moved], map_std)
    covariances = covariances_along(dense[moved], start, scans, noise.modelled)
    return np.sqrt(covariances[:, 0, 0] + covariances[:, 1, 1]), along[moved]


def check_routes(
    environment: Environment, radius: float, routes: Sequence[tuple[str, Route]]
) -> tuple[Route, ...]:
    """Check that a disc can drive given routes.

    Args:
        environment: The building.
        radius: Radius of the disc, metres.
        routes: Routes with their names in messages.

    Raises:
        InputError: there is none, one has no length, or the disc collides on it.
    """
    if not routes:
        raise InputError("routes: none is given; give one or more, or let them be sampled.")
    for name, route in routes:
        if not route.steering.lengths(route.poses[:-1], route.poses[1:]).sum() > 0.0:
            raise InputError(f"{name}: the route has no length; give two different places.")
        checker = CollisionChecker(environment, Footprint.disc(radius), route.steering)
        x, y, theta = route.poses.T
        bad = np.flatnonzero(~checker.poses_free(route.poses))
        verb = "stand"
        if not bad.size:
            bad = np.flatnonzero(~checker.motions_free(route.poses[:-1], route.poses[1:]))
            verb = "drive on"
        if bad.size:
            at = bad[0]
            why = checker.why_not(float(x[at]), float(y[at]), float(theta[at])) or "blocked"
            raise InputError(
                f"{name}: at ({x[at]:.2f}, {y[at]:.2f}) m a robot of radius {radius:g} m cannot "
                f"{verb} ({why}); give a route of this building, or a smaller robot radius."
            )
    return tuple(route for _, route in routes)
