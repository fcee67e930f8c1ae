"""Drives of a localizer study: settings, sampled routes, and how many robots get lost on each."""

from __future__ import annotations

import dataclasses
import warnings
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from ambinav.config import as_count
from ambinav.drive.localizer_spec import ChosenLocalizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.forecasting.calibrate import DrivenRoute
from ambinav.forecasting.ensemble import EnsembleRunner
from ambinav.forecasting.forecast import START_STD, sampled
from ambinav.forecasting.information_field import InformationField
from ambinav.forecasting.kept_drives import KeptDrives
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.geometry.collision.reach import reach_of
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.maps.content_digest import environment_digest
from ambinav.routes.route import Route
from ambinav.routes.sampled import path_length, sample_routes
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.progress import Progress, within
from ambinav.runtime.provenance import code_digest, digest_of
from ambinav.sensing.scanner import RangeScanner
from ambinav.store.map_store import MapStore

SHORTEST, LONGEST = 6.0, 70.0
"""Length of routes, metres."""
DRAWN_FOR_ONE = 4
"""Routes that are sampled for each that is driven: some are too short or too long."""
MARGIN = 0.03
"""Metres that a robot keeps from walls beyond its radius."""
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


def fair_routes(name: str, environment: Environment, settings: StudySettings) -> tuple[Route, ...]:
    """Sample shortest routes of a building, not too short and not too long.

    Warns:
        InputWarning: there is none.
    """
    count = DRAWN_FOR_ONE * settings.routes
    try:
        reach = reach_of(environment, settings.robot.radius + MARGIN)
        drawn = sample_routes(environment, reach, count, rng_of(settings.seed, name, "routes"))
    except InputError as error:
        warnings.warn(f"{error} The building is left out.", InputWarning, stacklevel=3)
        return ()
    fair = [route for route in drawn if SHORTEST <= path_length(route) <= LONGEST]
    if not fair:
        warnings.warn(
            f"{name}: none of {count} sampled routes is {SHORTEST:g} to {LONGEST:g} m long, so "
            "the building is left out.",
            InputWarning,
            stacklevel=3,
        )
    return tuple(fair[: settings.routes])


class Driver:
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
        progress: Progress,
    ) -> Iterator[DrivenRoute]:
        """Yield the routes of a building, driven with the scanner of this name."""
        if not routes:
            return
        settings, begin = self._settings, self._begin
        scanner = settings.scanners[name]
        amap = build_map(
            environment, scanner, spacing=settings.spacing, store=self._store,
            progress=within(progress, 0.0, 0.5),
        )  # fmt: skip
        field = InformationField.of(amap, echoes=begin.limited_by_echoes(scanner))
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
                rng = rng_of(settings.seed, *words)
                lost = int(runner(which).drive(route, rng, settings.runs).lost.sum())
                self._kept.add(drive, lost)
            poses, _ = sampled(route, begin.distance, begin.angle)
            progress(0.5 + 0.5 * (k + 1) / len(routes))
            yield DrivenRoute(building, field, poses, noise, lost, settings.runs)


def rng_of(seed: int, *words: str | int) -> np.random.Generator:
    """Return random numbers of their own for a purpose."""
    return np.random.default_rng([seed, *(zlib.crc32(str(word).encode()) for word in words)])
