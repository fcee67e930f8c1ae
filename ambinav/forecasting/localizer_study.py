"""Study of a localizer: robots drive sampled routes in many buildings, and its class is fitted.

What a localizer of the registry gains from a scan is not asked of its code: it drives shortest
routes between random places (`ambinav.routes.sampled`) as an ensemble (`EnsembleRunner`), with
several scanners and odometries, and `calibrate` fits its class to how often it got lost.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import Any

import numpy as np

from ambinav.drive.localizer_spec import chosen_localizer
from ambinav.drive.noise import OdometryNoise
from ambinav.drive.robot import Robot
from ambinav.forecasting.calibrate import FOLDS, Calibration, DrivenRoute, calibrate
from ambinav.forecasting.forecast import START_STD
from ambinav.forecasting.kept_drives import KeptDrives
from ambinav.forecasting.localizer_class import ECHO_GAINS, LocalizerClass
from ambinav.forecasting.study_drives import RATE, Driver, StudySettings, fair_routes, rng_of
from ambinav.geometry.environment import Environment
from ambinav.localization.parameters import MclParameters
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.runtime.progress import Progress, silent, step_of
from ambinav.store.map_store import MapStore
from ambinav.version import __version__

LEAST_STEP = 0.05
"""Metres and radians between updates of a class, at least: as between two scans."""


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
        fitted = self.calibration
        made = (
            f"{datetime.now(UTC):%Y-%m-%d}, ambinav {__version__}: {len(self.routes)} routes with "
            f"{', '.join(dict.fromkeys(self.scanners))} in {self.buildings} buildings, "
            f"{self.routes[0].runs} runs each; Brier skill on buildings left out "
            f"{fitted.skill_text}"
        )
        interval = float(f"{fitted.skill.low:.2g}"), float(f"{fitted.skill.high:.2g}")
        return replace(fitted.localizer, made=made, skill=interval)

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
    return replace(
        begin,
        distance=max(distance, LEAST_STEP),
        angle=max(angle, LEAST_STEP),
        echo_gain=ECHO_GAINS.get(chosen.parameters.laser_model_type),
    )


def study_localizer(
    begin: LocalizerClass,
    buildings: Mapping[str, Environment],
    settings: StudySettings,
    *,
    kept: KeptDrives | None = None,
    store: bool | MapStore = True,
    progress: Progress = silent,
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
    driver = Driver(begin, settings, KeptDrives(None) if kept is None else kept, store)
    for called, scanner in settings.scanners.items():
        note = driver.localizer(scanner, OdometryNoise()).note(scanner)
        if note is not None:
            warnings.warn(f"{called}: {note}", InputWarning, stacklevel=2)
    parts = len(buildings) * len(settings.scanners) + 1
    driven: list[DrivenRoute] = []
    scanners: list[str] = []
    for i, (name, environment) in enumerate(buildings.items()):
        routes = fair_routes(name, environment, settings)
        for j, called in enumerate(settings.scanners):
            part = step_of(progress, i * len(settings.scanners) + j, parts)
            for route in driver.drives(name, environment, called, routes, part):
                driven.append(route)
                scanners.append(called)
    calibration = calibrate(
        begin, driven, rng_of(settings.seed, "folds"), start_std=START_STD,
        progress=step_of(progress, parts - 1, parts),
    )  # fmt: skip
    return StudiedRoutes(tuple(driven), tuple(scanners), calibration)
