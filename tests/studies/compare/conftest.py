"""A small scenario that the tests of comparisons share."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.inline import inline_drives

SCENARIO: dict[str, Any] = {
    "environment": "flat.geojson",
    "scanner": {
        "name": "laser",
        "parts": [
            {
                "sensor": {"max_range": 3.0, "std": 0.02, "resolution": 0.001},
                "planar": {"beams": 24, "aperture_deg": 360},
            }
        ],
    },
    "map": {"spacing": 0.2},
    "robot": {"radius": 0.1},
    "localizer": {"min_particles": 100, "max_particles": 200},
    "pairs": [{"name": "there", "start": [1, 1], "goal": [7, 2]}],
    "routes": ["shortest", {"kind": "reference", "weight": 5}],
    "drive": {"runs": 12, "seed": 3, "open_loop": True},
}


def ring(left: float, low: float, right: float, high: float) -> list[list[float]]:
    return [[left, low], [right, low], [right, high], [left, high], [left, low]]


@pytest.fixture(autouse=True)
def quickly_drawn(coarse_pictures: None) -> None:
    """Draw coarse pictures, which take half of a comparison's time here."""


@pytest.fixture(autouse=True)
def seeded_plans(forked_plans: object) -> None:
    """Start no interpreter for each plan with a seed."""


@pytest.fixture(scope="module", autouse=True)
def drives_of_one_job() -> Iterator[None]:
    """Start none for comparisons with `--jobs 1` either."""
    with inline_drives():
        yield


@pytest.fixture
def scenario() -> dict[str, Any]:
    """The plain values of a scenario, to be changed."""
    return copy.deepcopy(SCENARIO)


def write(folder: Path, plain: object) -> Path:
    """A folder with a building and a scenario in it; returns the scenario."""
    shapes = [("room", ring(0, 0, 8, 3)), ("obstacle", ring(3, 1.2, 4, 2))]
    features = [
        {
            "type": "Feature",
            "properties": {"kind": kind},
            "geometry": {"type": "Polygon", "coordinates": [corners]},
        }
        for kind, corners in shapes
    ]
    whole = {"type": "FeatureCollection", "features": features}
    (folder / "flat.geojson").write_text(json.dumps(whole))
    path = folder / "flat.yaml"
    path.write_text(yaml.safe_dump(plain))
    return path
