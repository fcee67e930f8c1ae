"""A study of drives in small halls, of which the wider ones are beyond a short laser's range."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ambinav.drive.odometries import ODOMETRIES
from ambinav.forecasting import localizer_study, study_drives
from ambinav.forecasting.calibrate import brier_skill, raw_shares
from ambinav.forecasting.forecast import START_STD, Forecaster
from ambinav.forecasting.kept_drives import KeptDrives
from ambinav.forecasting.localizer_class import LocalizerClass
from ambinav.forecasting.localizer_study import StudiedRoutes, study_localizer, uncalibrated
from ambinav.forecasting.study_drives import LONGEST, SHORTEST, StudySettings, fair_routes
from ambinav.geometry.environment import Environment
from ambinav.map_building.build import build_map
from ambinav.runtime.errors import InputError, InputWarning
from tests.drive.cases import laser
from tests.geometry.scenes import room

SMALL = {"type": "amcl", "min_particles": 60, "max_particles": 120}
SETTINGS = StudySettings(
    scanners={"short": laser(1.5, 24)}, odometries={"poor": ODOMETRIES["poor"]},
    routes=2, runs=16, spacing=0.5, seed=1,
)  # fmt: skip


def halls(depths: tuple[float, ...], width: float = 11.0) -> dict[str, Environment]:
    return {f"hall-{k}": room(width + 0.3 * k, depth) for k, depth in enumerate(depths)}


HALLS = halls((1.6, 1.8, 2.0, 7.0, 9.0))


class Study(NamedTuple):
    """What was studied, the file of its drives, and the progress."""

    studied: StudiedRoutes
    drives: Path
    progress: list[float]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Study:
    path = tmp_path_factory.mktemp("study") / "drives"
    progress: list[float] = []
    result = study_localizer(
        uncalibrated("small", SMALL), HALLS, SETTINGS, kept=KeptDrives(path), store=False,
        progress=progress.append,
    )  # fmt: skip
    return Study(result, path, progress)


@pytest.fixture
def studied(study: Study) -> StudiedRoutes:
    return study.studied


def test_progress_rises_to_one(study: Study) -> None:
    assert study.progress == sorted(study.progress)
    assert 0.9 < study.progress[-1] <= 1.0


def test_begun_again_it_drives_nothing(study: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    with study.drives.open("a") as file:
        file.write('\n{"drive": "ab')  # where a run was interrupted
    kept = KeptDrives(study.drives)
    assert len(kept) == len(study.studied.routes)
    monkeypatch.setattr(study_drives, "EnsembleRunner", None)
    monkeypatch.setattr(localizer_study, "calibrate", lambda *_, **__: study.studied.calibration)
    begin = uncalibrated("small", SMALL)
    again = study_localizer(begin, HALLS, SETTINGS, kept=kept, store=False)
    assert np.array_equal(again.lost, study.studied.lost)
    kept.add("ab", 3)
    assert KeptDrives(study.drives).get("ab") == 3
    kept.remove()
    assert not study.drives.exists()


def test_outcomes_are_of_the_drives(studied: StudiedRoutes) -> None:
    assert studied.buildings == len(HALLS)
    assert studied.scanners == ("short",) * len(studied.routes)
    wide = np.array([HALLS[route.building].bounds[3] > 5.0 for route in studied.routes])
    assert studied.lost[wide].mean() > 0.3 > studied.lost[~wide].mean()
    assert np.array_equal(studied.lost, [route.lost / 16 for route in studied.routes])


def test_class_file_is_read_again(studied: StudiedRoutes, tmp_path: Path) -> None:
    path = tmp_path / "small.yaml"
    studied.localizer.to_yaml(path)
    entry = LocalizerClass.load(path)
    assert entry.name == "small"
    assert entry.localizer == SMALL
    assert entry.gain == pytest.approx(studied.localizer.gain, rel=1e-3)
    assert f"{len(studied.routes)} routes with short in 5 buildings, 16 runs each" in entry.made
    environment = HALLS["hall-3"]
    amap = build_map(environment, SETTINGS.scanners["short"], spacing=0.5, store=False)
    skill = studied.calibration.skill
    assert entry.skill == pytest.approx((skill.low, skill.high), rel=0.05)
    with warnings.catch_warnings():
        # So few routes may or may not show a skill.
        warnings.simplefilter("ignore", InputWarning)
        runner = Forecaster(amap, "poor", path).runner()
    (route, *_) = fair_routes("hall-3", environment, SETTINGS)
    assert runner.compiled
    assert len(runner.drive(route, np.random.default_rng(1), 16)) == 16


def test_routes_are_of_fair_length() -> None:
    routes = fair_routes("hall", HALLS["hall-4"], SETTINGS)
    assert len(routes) == SETTINGS.routes
    for route in routes:
        assert SHORTEST <= np.hypot(*np.diff(route.poses[:, :2], axis=0).T).sum() <= LONGEST
    with pytest.warns(InputWarning, match="closet: none of 8 sampled routes is 6 to 70 m long"):
        assert fair_routes("closet", room(2.0, 2.0), SETTINGS) == ()


def test_class_before_the_study() -> None:
    begin = uncalibrated("mine", {**SMALL, "update_min_d": 0.1, "update_min_a": 0.0})
    assert (begin.name, begin.distance, begin.angle) == ("mine", 0.1, 0.05)
    assert uncalibrated("ekf", "ekf").distance == 0.25
    with pytest.raises(InputError, match="there is no localizer 'gps'"):
        uncalibrated("gps", "gps")
    with pytest.raises(InputError, match="particles"):
        uncalibrated("mine", {"type": "amcl", "particles": 3})


def test_refuses_what_tells_nothing() -> None:
    begin = uncalibrated("small", SMALL)
    few = dict(list(HALLS.items())[:3])
    with pytest.raises(InputError, match="there are 3 buildings; give at least 5"):
        study_localizer(begin, few, SETTINGS, store=False)
    with pytest.raises(InputError, match="scanners: there are none; give at least one"):
        StudySettings(scanners={}, odometries=ODOMETRIES)
    with pytest.raises(InputError, match="runs is 1; give at least 2"):
        StudySettings(scanners=SETTINGS.scanners, odometries=ODOMETRIES, runs=1)


@pytest.mark.sweep
def test_class_forecasts_other_drives() -> None:
    """A class of drives in eight halls forecasts those in five others, of two odometries."""
    settings = StudySettings(
        scanners={"short": laser(2.0, 36)},
        odometries={name: ODOMETRIES[name] for name in ("mediocre", "poor")},
        routes=5, runs=24, spacing=0.25, seed=2,
    )  # fmt: skip
    drawn = np.random.default_rng(5).uniform(2.0, 10.0, size=13).tolist()
    known, new = halls(tuple(drawn[:8]), 16.0), halls(tuple(drawn[8:]), 14.0)
    begin = uncalibrated("amcl", "amcl")
    fitted = study_localizer(begin, known, settings, store=False)
    assert fitted.calibration.skill.low > 0.0
    other = study_localizer(begin, new, settings, store=False)
    start = np.diag(np.square(START_STD))
    forecasts = fitted.localizer.calibrated(raw_shares(fitted.localizer, other.routes, start))
    assert brier_skill(forecasts, other.lost) > 0.3
    assert math.isclose(forecasts.mean(), other.lost.mean(), abs_tol=0.15)
