"""Environments with sonars: which localizer they have by default."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from ambinav.localization.parameters import MclParameters
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.navigation import NavigationEnv
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.vector import NavigationVectorEnv
from tests.envs.cases import equal, room

RING = RangeScanner.from_preset("hc-sr04")


def test_particle_filters_suit_the_scanner_by_default() -> None:
    parameters = NavigationParameters(scanner=RING, localizer="mcl")
    alphas = {f"alpha{k}": 0.2 * parameters.odometry.scale**2 for k in range(1, 5)}
    assert parameters.particles == MclParameters.for_scanner(RING, **alphas)
    assert parameters.particles.laser_model_type == "beam_prob"
    few = NavigationParameters(scanner=RING, mcl={"max_particles": 700, "z_hit": 0.5})  # type: ignore[arg-type]
    assert few.particles == MclParameters.for_scanner(RING, max_particles=700, z_hit=0.5)
    # Whole parameters are taken as they are, and lasers have AMCL's.
    own = MclParameters(max_particles=700)
    assert NavigationParameters(scanner=RING, mcl=own).particles == own
    assert NavigationParameters().particles == MclParameters(**alphas)
    laser = NavigationParameters(mcl={"max_particles": 700})  # type: ignore[arg-type]
    assert laser.particles == own
    with pytest.raises(InputError, match=r"^mcl: the key 'z_hot' is unknown; did you mean .*z_hit"):
        NavigationParameters(scanner=RING, mcl={"z_hot": 0.5})  # type: ignore[arg-type]
    assert replace(few, people=1).particles == few.particles


@pytest.mark.sweep
def test_a_batch_with_sonars_is_the_single_environment_too() -> None:
    mcl = {"max_particles": 200, "min_particles": 100}
    options: dict[str, Any] = {
        "map": room(), "scanner": RING, "localizer": "mcl", "mcl": mcl, "max_steps": 10,
    }  # fmt: skip
    many = NavigationVectorEnv(2, **options)
    single = SyncVectorEnv([lambda: NavigationEnv(**options)] * 2)
    equal(many.reset(seed=1), single.reset(seed=1))
    for action in np.random.default_rng(0).uniform(-1, 1, (15, 2, 2)).astype(np.float32):
        equal(many.step(action), single.step(action))


@pytest.mark.slow
def test_fields_are_warned_of() -> None:
    mcl = {"laser_model_type": "likelihood_field"}
    env = NavigationEnv(map=room(), scanner=RING, localizer="mcl", mcl=mcl)
    with pytest.warns(InputWarning, match="laser_model_type likelihood_field takes every echo"):
        env.reset(seed=1)
