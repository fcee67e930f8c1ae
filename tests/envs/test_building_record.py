"""What kernels read of buildings: one type for all, so that they are compiled once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numba
import pytest

from ambinav.buildings.load import load_environment
from ambinav_envs.navigation import NavigationEnv
from tests.envs.cases import room

DEMO = Path(__file__).parents[2] / "configs" / "demo.geojson"


@pytest.mark.slow
@pytest.mark.parametrize(
    "building", [{"map": load_environment(DEMO)}, {"suite": "office", "buildings": 1}]
)
def test_all_buildings_are_of_one_type(building: dict[str, Any]) -> None:
    kinds = set()
    for options in ({"map": room()}, building):
        env = NavigationEnv(**options)
        env.reset(seed=0)
        site = env.simulation.sites[0]
        assert site is not None
        kinds.add(numba.typeof((site.record, site.costs_to_go.arrays)))
    assert len(kinds) == 1


def test_arrays_hold_what_their_names_say() -> None:
    env = NavigationEnv(map=room())
    env.reset(seed=0)
    site = env.simulation.sites[0]
    assert site is not None
    record, amap = site.record, site.building.amap
    layers, free = record.layers, amap.dataset["free"].values
    assert (layers.free == free).all()
    for name, array in (("level", layers.level), ("fisher", layers.fisher)):
        assert (array[:, :, 0][free] == amap.dataset[name].values[free]).all()
    assert record.bounds == room().bounds
    assert site.costs_to_go.arrays.frame == site.lattice.frame
    assert record.noise.near.shape == record.noise.row.shape == (60,)
