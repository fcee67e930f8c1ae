"""Forecast of a route: how far off a robot's localizer will be, and how likely it gets lost."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from types import NoneType

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import as_positive, check_kind
from ambinav.drive.drive import checked_start_std
from ambinav.drive.metrics import LOST_HEADING, LOST_POSITION
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.odometries import odometry_of
from ambinav.drive.robot import Robot
from ambinav.forecasting.causes import Cause, causes_of
from ambinav.forecasting.ensemble import EnsembleRunner, LostRule
from ambinav.forecasting.filter_kernel import forecast_rows, updates_apart
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.reliability import ReliabilityBin, bin_at
from ambinav.geometry.environment import Environment
from ambinav.geometry.lattice import STEPS
from ambinav.geometry.segments import FRONTIER
from ambinav.localization.expected_covariance import place_and_scanner
from ambinav.maps.ambiguity_map import AmbiguityMap
from ambinav.maps.zones import LOCALIZABLE
from ambinav.routes.route import Route
from ambinav.runtime.array_types import Bools, Floats, Ints
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.threads import run_rows

FINER = 5
"""Points of a route that are looked at for each distance between updates."""
FAR = 100.0
"""A route so many times farther off than a map is large is not sampled."""
OFF_FLOOR = 0.1
"""Share of a route's places that may be farther than a cell from the free cells of the map."""
TOUCHING = 1e-3
"""Metres by which a step of a route has to go on behind a wall to cross it."""
START_STD = (0.05, 0.05, 0.02)
"""Deviations of x, y (metres) and heading (radians) at the start, as those of `drive_route`."""


@dataclass(frozen=True, eq=False)
class Forecast:
    """Expected error and lost share of a localizer along a route, at n places.

    Attributes:
        poses: x, y (metres) and heading (radians), map frame, shape (n, 3).
        distance: Metres along the route, shape (n,).
        covariance: Of the error of robots that are not lost, x, y (metres) and heading (radians),
            shape (n, 3, 3).
        lost: Share of robots that have been lost on the way there, shape (n,); it never falls.
        causes: Stretches on which robots get lost, the worst first; () of a class without skill.
        localizer: The class of localizer that it is of.
        odometry: Errors of the odometry that it is of.
        reliability: How many robots got lost where about as many were forecast to; None: that was
            not measured.
    """

    poses: Floats
    distance: Floats
    covariance: Floats
    lost: Floats
    causes: tuple[Cause, ...]
    localizer: LocalizerClass
    odometry: OdometryNoise
    reliability: ReliabilityBin | None = None

    def __post_init__(self) -> None:
        """Drop the causes where the class cannot tell them."""
        if not self.localizer.has_skill:
            object.__setattr__(self, "causes", ())

    @property
    def lost_probability(self) -> float:
        """Probability that a robot gets lost on the route."""
        return float(self.lost[-1])

    @property
    def expected_error(self) -> Floats:
        """Root mean square error of the position of robots that are not lost, metres, (n,)."""
        return np.sqrt(self.covariance[:, 0, 0] + self.covariance[:, 1, 1])

    @property
    def sentence(self) -> str:
        """The probability and its main cause in words."""
        where = f", {self.causes[0]}" if self.causes else ""
        return f"{in_words(self.lost_probability)} lost on this route{where}."

    def __repr__(self) -> str:
        """Return probability and largest error as text."""
        return (
            f"<Forecast of {self.localizer.name!r} over {self.distance[-1]:.1f} m: "
            f"{100.0 * self.lost_probability:.1f} % lost, "
            f"error up to {self.expected_error.max():.2f} m>"
        )


class Forecaster:
    """Forecasts of routes on one map, for one odometry and one class of localizer.

    Args:
        amap: The map.
        odometry: Errors of the odometry: a name of `ODOMETRIES`, or an `OdometryNoise`; None:
            those that a comparison of routes simulates, `OdometryNoise()`.
        localizer: Class of localizer: a name of `localizer_classes()`, the YAML file of one, or a
            `LocalizerClass`.
        start_std: Deviations of x, y (metres) and heading (radians) at the start, up to the limits.
        position_limit: Metres off from which a robot is lost.
        heading_limit: Radians off from which a robot is lost.
        lateral_limit: Metres across the robot's heading from which it is lost, as on a lane; then
            `position_limit` holds along the heading. None: it holds in any direction.
        environment: What the map was built of; None: as the map keeps it, which of buildings in
            space is the floor alone.
        routes: The only routes that will be asked for: the map's information is computed near
            them, in less time. None: everywhere.

    Attributes:
        map: The map.
        odometry: Errors of the odometry.
        localizer: The class of localizer.
        field: Information of the map's scans.
        start: Covariance at the start of routes, shape (3, 3).
        settings: Localizer and limits, for the kernels.

    Raises:
        InputError: a name is unknown, a number is not above 0, a robot would start beyond the
            limits, or the map does not tell its scanner or does not keep the walls that it sees.
    """

    def __init__(
        self,
        amap: AmbiguityMap,
        odometry: str | OdometryNoise | None = None,
        localizer: str | LocalizerClass = "product",
        *,
        start_std: ArrayLike = START_STD,
        position_limit: float = LOST_POSITION,
        heading_limit: float = LOST_HEADING,
        lateral_limit: float | None = None,
        environment: Environment | None = None,
        routes: Sequence[Route] | None = None,
    ) -> None:
        check_kind(amap, AmbiguityMap, "amap")
        check_kind(environment, (Environment, NoneType), "environment")
        self.odometry = odometry_of(odometry)
        self.localizer = LocalizerClass.load(localizer)
        self.map = amap
        map_environment, scanner = place_and_scanner(amap, None)
        self._building = map_environment if environment is None else environment
        self._scanner = scanner
        note = self.localizer.chosen(scanner, self.odometry).note(scanner)
        if note is not None:
            warnings.warn(
                f"localizer {self.localizer.name!r} was not calibrated for this: {note}",
                InputWarning,
                stacklevel=2,
            )
        if self.localizer.skill is not None and not self.localizer.has_skill:
            low, high = self.localizer.skill
            warnings.warn(
                f"localizer {self.localizer.name!r} forecast lost robots no better than their mean "
                f"share (Brier skill {low:g} to {high:g} in buildings left out): its forecasts "
                "order no routes and name no cause.",
                InputWarning,
                stacklevel=2,
            )
        self._only, poses = None, None
        if routes is not None:
            sampled_poses = [self._sampled(route)[0] for route in _checked(routes)]
            poses = np.concatenate([np.empty((0, 3)), *sampled_poses])
            self._only = frozenset(part.tobytes() for part in sampled_poses)
        self.field = InformationField.of(
            amap, environment, poses, echoes=self.localizer.limited_by_echoes(scanner)
        )
        self.settings = self.localizer.settings(
            as_positive(position_limit, "position_limit", "metres"),
            as_positive(heading_limit, "heading_limit", "radians"),
            None
            if lateral_limit is None
            else as_positive(lateral_limit, "lateral_limit", "metres"),
        )
        deviations = checked_start_std(start_std)
        for limit, name, deviation, shown_as in (
            (position_limit, "position_limit", max(deviations[:2]), "{:.3g} m"),
            (lateral_limit, "lateral_limit", max(deviations[:2]), "{:.3g} m"),
            (heading_limit, "heading_limit", deviations[2], "{0:.3g} rad ({1:.3g} degrees)"),
        ):
            if limit is not None and deviation > limit:
                below, at_start = (shown_as.format(a, math.degrees(a)) for a in (limit, deviation))
                raise InputError(
                    f"{name} is {below}, below the deviation of {at_start} at the start; a "
                    "forecast is of robots that know where they start: give a higher limit, or in "
                    "Python a smaller start_std."
                )
        self.start = np.diag(np.square(deviations))

    def __call__(self, route: Route) -> Forecast:
        """Return the forecast of a route.

        Raises:
            InputError: the route does not lie on the map's floor, or is none of `routes`.
        """
        poses, along = self._sampled(*_checked([route]))
        covariance, lost = self._run(poses, np.array([0, len(poses)]))
        self._note_walls(poses)
        lost = self.localizer.calibrated(lost)
        localizable = self.map.sample("zone", poses[:, 0], poses[:, 1], poses[:, 2]) == LOCALIZABLE
        causes = causes_of(poses, along, lost, covariance, self.lost_rule, localizable)
        return Forecast(
            poses, along, covariance, lost, causes, self.localizer, self.odometry,
            self.reliability(float(lost[-1])),
        )  # fmt: skip

    @property
    def lost_rule(self) -> LostRule:
        """When a driven robot is lost by the same limits."""
        across = self.settings.lateral_limit
        return LostRule(
            self.settings.position_limit,
            self.settings.heading_limit,
            lateral=None if math.isinf(across) else across,
        )

    def reliability(self, probability: float) -> ReliabilityBin | None:
        """Return how many robots got lost where about as many were forecast to.

        None: that was not measured, as for other limits or another start than the default ones.
        """
        measured = np.array_equal(self.start, np.diag(np.square(START_STD)))
        if not measured or self.lost_rule != LostRule():
            return None
        return bin_at(self.localizer.reliability, probability)

    def lost_probabilities(self, routes: Sequence[Route]) -> Floats:
        """Return the probability that a robot gets lost on each route, shape (K,).

        Raises:
            InputError: a route does not lie on the map's floor, or is none of `routes`.
        """
        if not _checked(routes):
            return np.empty(0)
        parts = [self._sampled(route)[0] for route in routes]
        first = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
        _, lost = self._run(np.concatenate(parts), first)
        return self.localizer.calibrated(lost[first[1:] - 1])

    def runner(self, robot: Robot | None = None) -> EnsembleRunner:
        """Return ensembles of the same localizer, odometry and limits, to check forecasts.

        Args:
            robot: The robot that drives; None: the default one.

        Raises:
            InputError: the class names a localizer that there is not, or the map does not keep the
                walls that a scanner sees.
        """
        return EnsembleRunner(
            self._building, self._scanner,
            self.localizer.chosen(self._scanner, self.odometry, robot),
            robot=robot, noise=self.odometry, start_std=np.sqrt(np.diag(self.start)),
            lost=self.lost_rule,
        )  # fmt: skip

    def _sampled(self, route: Route) -> tuple[Floats, Floats]:
        xmin, ymin, xmax, ymax = self.map.bounds
        size = math.hypot(xmax - xmin, ymax - ymin)
        x, y = route.poses[:, 0], route.poses[:, 1]
        far = np.maximum.reduce([xmin - x, x - xmax, ymin - y, y - ymax]) > FAR * size
        if far.any():
            # Before its samples fill the memory.
            k = int(far.argmax())
            raise InputError(
                f"route: ({x[k]:.6g}, {y[k]:.6g}) m is far from the floor of {self.map.source}; "
                "give the map that it was planned on."
            )
        poses, along = sampled(route, self.localizer.distance, self.localizer.angle)
        if self._only is not None and poses.tobytes() not in self._only:
            raise InputError(
                f"route of {along[-1]:.1f} m: it is none of the routes that this Forecaster was "
                "made for; make one for it, or one without `routes`."
            )
        return poses, along

    def _note_walls(self, poses: Floats) -> None:
        """Warn of a route through a wall, as of another building's."""
        dx, dy = np.diff(poses[:, :2], axis=0).T
        away = np.hypot(dx, dy)
        kinds = self._building.segments.kind
        if not away.any() or not len(kinds):
            return
        x, y = poses[:-1, 0], poses[:-1, 1]
        echo, wall = self._building.cast_hits(x, y, np.arctan2(dy, dx), float(away.max()))
        crossing = np.flatnonzero((kinds[wall] != FRONTIER) & (echo < away - TOUCHING))
        if len(crossing):
            k = crossing[0]
            warnings.warn(
                f"the route crosses walls of {self.map.source}, first near ({x[k]:.1f}, {y[k]:.1f})"
                " m; give the map that it was planned on",
                InputWarning,
                stacklevel=3,
            )

    def _floor(self, x: Floats, y: Floats) -> Bools:
        return np.asarray(self.map.sample("free", x, y)) >= 0.5

    def _check(self, poses: Floats, first: Ints) -> None:
        """Refuse routes that do not lie on the map's floor; arguments as of `forecast_rows`."""
        off = ~self._floor(poses[:, 0], poses[:, 1])
        if off.any():
            # A small robot passes between a wall and the centre of the cell beside it.
            x, y = poses[off, :2].T
            near = [self._floor(x + dx, y + dy) for dx, dy in STEPS * self.map.spacing]
            off[off] = ~np.logical_or.reduce(near)
        counts = np.add.reduceat(off.astype(np.int64), first[:-1])
        wrong = counts > OFF_FLOOR * np.diff(first)
        if wrong.any():
            route = int(wrong.argmax())
            x, y = poses[first[route] + int(off[first[route] :].argmax()), :2].tolist()
            raise InputError(
                f"route: ({x:.1f}, {y:.1f}) m and {counts[route] - 1} more of "
                f"{first[route + 1] - first[route]} places are not on free floor of "
                f"{self.map.source}; give the map that it was planned on, or one of a smaller "
                "spacing."
            )

    def _run(self, poses: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return covariances, (M, 3, 3), and lost shares before calibration, (M,)."""
        self._check(poses, first)
        covariance, lost = np.empty((len(poses), 3, 3)), np.empty(len(poses))
        run_rows(
            forecast_rows, len(first) - 1, first.astype(np.int64), poses, self.start,
            self.field.fields, self.field.lattice, self.odometry.packed, self.settings,
            covariance, lost, least=8,
        )  # fmt: skip
        return covariance, lost


def forecast(
    amap: AmbiguityMap,
    route: Route,
    odometry: str | OdometryNoise | None = None,
    localizer: str | LocalizerClass = "product",
    *,
    start_std: ArrayLike = START_STD,
    position_limit: float = LOST_POSITION,
    heading_limit: float = LOST_HEADING,
    lateral_limit: float | None = None,
) -> Forecast:
    """Forecast how far off a localizer will be along a route, and how likely it gets lost.

    Arguments beside the route as for `Forecaster`, which forecasts many routes of a map faster.

    Raises:
        InputError: see `Forecaster`, and its call.
    """
    forecaster = Forecaster(
        amap, odometry, localizer,
        start_std=start_std, position_limit=position_limit, heading_limit=heading_limit,
        lateral_limit=lateral_limit,
    )  # fmt: skip
    return forecaster(route)


def sampled(route: Route, distance: float, angle: float) -> tuple[Floats, Floats]:
    """Return poses along a route, an update of the localizer apart.

    Args:
        route: The route.
        distance: Metres from one update to the next.
        angle: Radians, likewise. A turn on the spot is one step, however far it is.

    Returns:
        Poses, shape (n, 3), the first and the last of the route among them, and the metres up to
        each, shape (n,).
    """
    poses, _, along = route.steering.dense(route.poses, distance / FINER)
    is_update = updates_apart(poses, along, distance, angle)
    return poses[is_update], along[is_update]


def in_words(probability: float) -> str:
    """Return a probability as "about 1 in 20 robots gets"."""
    if probability < 0.001:
        return "fewer than 1 in 1000 robots get"
    if probability >= 0.95:
        return "nearly all robots get"
    if probability >= 0.35:
        tenths = math.floor(10.0 * probability + 0.5 + 1e-9)
        return "about half of the robots get" if tenths == 5 else f"about {tenths} in 10 robots get"
    one_in = 1.0 / probability
    step = 10.0 ** max(math.floor(math.log10(one_in)) - 1, 0)
    rounded = step * round(one_in / step) if one_in >= 10.0 else round(one_in)
    return f"about 1 in {rounded:g} robots gets"


def _checked(routes: Sequence[Route]) -> Sequence[Route]:
    """Return routes, refused unless they are some."""
    check_kind(routes, Sequence, "routes", "give a list of routes")
    for route in routes:
        check_kind(route, Route, "a route", "give what a planner or `load_route` returns")
    return routes
