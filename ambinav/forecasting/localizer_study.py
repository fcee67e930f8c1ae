"""Study of a localizer: robots drive sampled routes in many buildings, and its class is fitted.

What a localizer of the registry gains from a scan is not asked of its code: it drives shortest
routes between random places (`ambinav.routes.sampled`) as an ensemble (`EnsembleRunner`), with
several scanners and odometries, and `calibrate` fits its class to how often it got lost.
"""

from __future__ import annotations

import dataclasses
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambinav.config import as_count
from ambinav.drive.localizer_spec import ChosenLocalizer, chosen_localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.forecasting.calibrate import FOLDS, Calibration, DrivenRoute, calibrate
from ambinav.forecasting.ensemble import EnsembleRunner
from ambinav.forecasting.forecast import START_STD, sampled
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.kept_drives import KeptDrives
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.geometry.collision.reach import reach_of
from ambinav.geometry.environment import Environment
from ambinav.localization.parameters import MclParameters
from ambinav.map_building.build import build_map
from ambinav.maps.content_digest import environment_digest
from ambinav.routes.route import Route
from ambinav.routes.sampled import sample_routes
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.provenance import code_digest, digest_of
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import MapStore
from ambinav.version import __version__

Floats = NDArray[np.float64]
Report = Callable[[float], None]

SHORTEST, LONGEST = 6.0, 70.0
"""Length of routes, metres."""
DRAWN_FOR_ONE = 4
"""Routes that are sampled for each that is driven: some are too short or too long."""
MARGIN = 0.03
"""Metres that a robot keeps from walls beyond its radius."""
LEAST_STEP = 0.05
"""Metres and radians between updates of a class, at least: as between two scans."""
RATE = 10.0
"""Scans a second."""


@dataclass(frozen=True, kw_only=True)
class StudySettings:
    """Settings of a study.

    Attributes:
        scanners: Scanners of the robots, by name; all drive the same routes.
        odometries: Odometries, by name; route k of a building has that at k modulo their number.
        routes: Number of routes in a building.
        runs: Number of robots that drive each route with each scanner.
        spacing: Of the maps, metres.
        seed: Of the routes and drives.
        robot: The robot.

    Raises:
        InputError: a number is out of its range, or there is no scanner or no odometry.
    """

    scanners: Mapping[str, RangeScanner]
    odometries: Mapping[str, OdometryNoise]
    routes: int = 8
    runs: int = 32
    spacing: float = 0.1
    seed: int = 0
    robot: Robot = dataclasses.field(default_factory=Robot)

    def __post_init__(self) -> None:
        for name in ("scanners", "odometries"):
            if not getattr(self, name):
                raise InputError(f"{name}: there are none; give at least one.")
        as_count(self.routes, "routes")
        # The ceiling takes the spread of the runs of a route.
        if as_count(self.runs, "runs") < 2:
            raise InputError(f"runs is {self.runs}; give at least 2.")


@dataclass(frozen=True, eq=False)
class StudiedRoutes:
    """Routes that a localizer drove, and what was fitted to them.

    Attributes:
        routes: The routes with their outcomes, K in all.
        scanners: Name of the scanner of each.
        calibration: The class, and its forecasts of the routes in buildings left out.
    """

    routes: tuple[DrivenRoute, ...]
    scanners: tuple[str, ...]
    calibration: Calibration

    @property
    def localizer(self) -> LocalizerClass:
        """The calibrated class, which says where it comes from."""
        fitted, skill = self.calibration, self.calibration.skill
        made = (
            f"{datetime.now(UTC):%Y-%m-%d}, ambinav {__version__}: {len(self.routes)} routes with "
            f"{', '.join(dict.fromkeys(self.scanners))} in {self.buildings} buildings, "
            f"{self.routes[0].runs} runs each; Brier skill on buildings left out "
            f"{skill.value:.2f} [{skill.low:.2f}, {skill.high:.2f}], at most {fitted.ceiling:.2f}"
        )
        return replace(fitted.localizer, made=made)

    @property
    def buildings(self) -> int:
        """Number of buildings."""
        return len({route.building for route in self.routes})

    @property
    def lost(self) -> Floats:
        """Share of the robots that got lost on each route, shape (K,)."""
        return np.array([route.lost / route.runs for route in self.routes])


def uncalibrated(name: str, plain: Mapping[str, Any] | str) -> LocalizerClass:
    """Return the class of a localizer before a study, to which `study_localizer` fits it.

    Args:
        name: Name of the class.
        plain: The localizer as in a scenario: a name of the registry, or a mapping with the key
            type and parameters.

    Raises:
        InputError: the type or a parameter is unknown, or a value makes no sense.
    """
    chosen = chosen_localizer(plain, OdometryNoise(), Robot(), RATE)
    title = chosen.spec.title if isinstance(plain, str) else chosen.title
    begin = LocalizerClass(name=name, title=title, gain=0.25, localizer=plain)
    if not isinstance(chosen.parameters, MclParameters):
        return begin
    # 0 takes in every scan.
    distance, angle = chosen.parameters.update_min_d, chosen.parameters.update_min_a
    return replace(begin, distance=max(distance, LEAST_STEP), angle=max(angle, LEAST_STEP))


def study_localizer(
    begin: LocalizerClass,
    buildings: Mapping[str, Environment],
    settings: StudySettings,
    *,
    kept: KeptDrives | None = None,
    store: bool | MapStore = True,
    progress: Report | None = None,
) -> StudiedRoutes:
    """Drive a localizer along sampled routes and fit its class to the outcomes.

    Args:
        begin: The class to begin with: its name, title, and what drives are of.
        buildings: Buildings by name, at least `FOLDS`; each is its own map.
        settings: Scanners, odometries and numbers.
        kept: Outcomes of an interrupted run, to which new ones are added.
        store: Store of the maps, as for `build_map`.
        progress: Called with the share done.

    Raises:
        InputError: there are too few buildings or routes, none or all of the robots got lost, or
            the localizer cannot be made.

    Warns:
        InputWarning: the localizer cannot use a scanner, or a building has no route of fair length.
    """
    if len(buildings) < FOLDS:
        raise InputError(
            f"there are {len(buildings)} buildings; give at least {FOLDS}, so that each part of "
            "them can be left out."
        )
    driver = _Driver(begin, settings, KeptDrives(None) if kept is None else kept, store)
    for called, scanner in settings.scanners.items():
        note = driver.localizer(scanner, OdometryNoise()).note(scanner)
        if note is not None:
            warnings.warn(f"{called}: {note}", InputWarning, stacklevel=2)
    report = progress or (lambda share: None)
    parts = len(buildings) * len(settings.scanners) + 1
    driven: list[DrivenRoute] = []
    scanners: list[str] = []
    for i, (name, environment) in enumerate(buildings.items()):
        routes = fair_routes(name, environment, settings)
        for j, called in enumerate(settings.scanners):
            before = i * len(settings.scanners) + j

            def report_part(share: float, before: int = before) -> None:
                report((before + share) / parts)

            for route in driver.drives(name, environment, called, routes, report_part):
                driven.append(route)
                scanners.append(called)
    calibration = calibrate(
        begin, driven, _rng(settings.seed, "folds"), start_std=START_STD,
        progress=lambda share: report((parts - 1 + share) / parts),
    )  # fmt: skip
    return StudiedRoutes(tuple(driven), tuple(scanners), calibration)


def fair_routes(name: str, environment: Environment, settings: StudySettings) -> tuple[Route, ...]:
    """Sample shortest routes of a building, not too short and not too long.

    Warns:
        InputWarning: there is none.
    """
    count = DRAWN_FOR_ONE * settings.routes
    try:
        reach = reach_of(environment, settings.robot.radius + MARGIN)
        drawn = sample_routes(environment, reach, count, _rng(settings.seed, name, "routes"))
    except InputError as error:
        warnings.warn(f"{error} The building is left out.", InputWarning, stacklevel=3)
        return ()
    fair = [route for route in drawn if SHORTEST <= _length(route) <= LONGEST]
    if not fair:
        warnings.warn(
            f"{name}: none of {count} sampled routes is {SHORTEST:g} to {LONGEST:g} m long, so "
            "the building is left out.",
            InputWarning,
            stacklevel=3,
        )
    return tuple(fair[: settings.routes])


class _Driver:
    """Drives of one localizer, a building and a scanner at a time."""

    def __init__(
        self,
        begin: LocalizerClass,
        settings: StudySettings,
        kept: KeptDrives,
        store: bool | MapStore,
    ) -> None:
        self._begin = begin
        self._settings = settings
        self._kept = kept
        self._store = store

    def localizer(self, scanner: RangeScanner, noise: OdometryNoise) -> ChosenLocalizer:
        """Return the localizer for a scanner and an odometry."""
        return self._begin.chosen(scanner, noise, self._settings.robot, RATE)

    def drives(
        self,
        building: str,
        environment: Environment,
        name: str,
        routes: tuple[Route, ...],
        report: Report,
    ) -> Iterator[DrivenRoute]:
        """Yield the routes of a building, driven with the scanner of this name."""
        if not routes:
            return
        settings, begin = self._settings, self._begin
        scanner = settings.scanners[name]
        amap = build_map(
            environment, scanner, spacing=settings.spacing, store=self._store,
            progress=lambda share: report(0.5 * share),
        )  # fmt: skip
        field = InformationField.of(amap)
        odometries = list(settings.odometries.values())
        made_of = digest_of(code_digest(), environment_digest(environment), scanner, settings.robot)

        @cache
        def runner(which: int) -> EnsembleRunner:
            noise = odometries[which]
            return EnsembleRunner(
                environment, scanner, self.localizer(scanner, noise), robot=settings.robot,
                noise=noise, start_std=START_STD, rate=RATE,
            )  # fmt: skip

        for k, route in enumerate(routes):
            which = k % len(odometries)
            noise = odometries[which]
            words = (building, name, k)
            drive = digest_of(
                made_of, self.localizer(scanner, noise).identity, noise, route.poses,
                settings.runs, settings.seed, words,
            )  # fmt: skip
            lost = self._kept.get(drive)
            if lost is None:
                rng = _rng(settings.seed, *words)
                lost = int(runner(which).drive(route, rng, settings.runs).lost.sum())
                self._kept.add(drive, lost)
            poses, _ = sampled(route, begin.distance, begin.angle)
            report(0.5 + 0.5 * (k + 1) / len(routes))
            yield DrivenRoute(building, field, poses, noise, lost, settings.runs)


def _length(route: Route) -> float:
    """Return the length of a route of straight segments, metres."""
    return float(np.hypot(*np.diff(route.poses[:, :2], axis=0).T).sum())


def _rng(seed: int, *words: str | int) -> np.random.Generator:
    """Return random numbers of their own for a purpose."""
    return np.random.default_rng([seed, *(zlib.crc32(str(word).encode()) for word in words)])
