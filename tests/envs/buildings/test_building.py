"""A building, and its map in the user's store."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ambinav as an
from ambinav.map_building import build as build_module
from ambinav_envs.buildings.building import Building
from tests.envs.buildings.scenes import laser, room


def files(cache: Path) -> list[Path]:
    return sorted((cache / "ambinav-maps").glob("*.map"))


def test_a_building(cache: Path) -> None:
    building = Building.of(room(), laser(), 0.3, 0.5, key="mine")
    assert building.key == "mine"
    assert not cache.exists()  # nothing is worked out before it is asked for
    assert building.amap is building.amap
    assert building.amap.spacing == 0.5
    assert {"level", "fisher"} <= set(building.amap.layers)
    assert len(files(cache)) == 1
    assert building.checker.footprint.radius == 0.3
    assert building.lattice.checker is building.checker
    assert Building.of(room(), laser(), 0.3).key == "room"
    for radius, spacing in ((-0.1, 0.2), (np.nan, 0.2), (0.2, 0.0), (0.2, np.inf)):
        with pytest.raises(an.InputError, match="give metres from"):
            Building.of(room(), laser(), radius, spacing)


def test_its_map_is_opened_the_second_time(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    built = Building.of(room(), laser(), 0.3, 0.5).amap
    with monkeypatch.context() as patch:
        patch.setattr(build_module, "_compute", None)
        opened = Building.of(room(), laser(), 0.2, 0.5, key="other robot").amap
    assert opened.dataset.identical(built.dataset)
    plain = Building.of(room(), laser(), 0.3, 0.5, keep=False).amap
    assert plain.dataset.assign_attrs(built.dataset.attrs).identical(built.dataset)


def test_nothing_is_kept_on_request(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert Building.of(room(), laser(), 0.3, 0.5, keep=False).amap.spacing == 0.5
    monkeypatch.setenv("AMBINAV_CACHE", "")
    assert Building.of(room(), laser(), 0.3, 0.5).amap.spacing == 0.5
    assert not cache.exists()
