"""Parameters: AMCL's names and defaults, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ambinav.localization.parameters import MclParameters
from ambinav.localization.scanner_settings import settings_for
from ambinav.runtime.errors import InputError
from ambinav.sensing.scanner import RangeScanner

# Declared in nav2_amcl/src/amcl_node.cpp.
AMCL = {
    "alpha1": 0.2, "alpha2": 0.2, "alpha3": 0.2, "alpha4": 0.2, "alpha5": 0.2,
    "lambda_short": 0.1, "laser_likelihood_max_dist": 2.0, "laser_max_range": 100.0,
    "laser_min_range": -1.0, "laser_model_type": "likelihood_field", "max_beams": 60,
    "max_particles": 2000, "min_particles": 500, "pf_err": 0.05, "pf_z": 0.99,
    "recovery_alpha_fast": 0.0, "recovery_alpha_slow": 0.0, "resample_interval": 1,
    "sigma_hit": 0.2, "update_min_a": 0.2, "update_min_d": 0.25, "z_hit": 0.5, "z_max": 0.05,
    "z_rand": 0.5, "z_short": 0.05,
}  # fmt: skip


def test_names_and_defaults_are_amcls() -> None:
    parameters = MclParameters()
    assert {key: getattr(parameters, key) for key in AMCL} == AMCL
    assert MclParameters.from_dict(AMCL) == parameters
    assert parameters.odometry.alpha3 == 0.2


@pytest.mark.parametrize(
    "values",
    [
        {"min_particles": 0}, {"max_particles": 100}, {"max_beams": 1}, {"pf_err": 0.0},
        {"z_hit": 1.5}, {"z_rand": -0.1}, {"sigma_hit": math.nan}, {"update_min_d": -1.0},
        {"resample_interval": 0}, {"laser_model_type": "beams"}, {"resampling": "sistematic"},
        {"estimate": "median"}, {"alpha2": -0.2}, {"initial_cov_aa": -1.0},
        {"recovery_alpha_slow": 0.1}, {"max_particles": 500.5}, {"likelihood_resolution": 0.0},
        {"laser_max_range": math.inf},
    ],
    ids=lambda values: next(iter(values)),
)  # fmt: skip
def test_bad_values_are_refused_by_name(values: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(values))):
        MclParameters(**values)


def test_products_need_random_readings() -> None:
    with pytest.raises(InputError, match="z_rand"):
        MclParameters(laser_model_type="likelihood_field_prob", z_rand=0.0)
    for key in ("z_rand", "z_max"):
        given: dict[str, Any] = {key: 0.0}
        with pytest.raises(InputError, match=f"{key} is 0.0; give more than 0 where beams are"):
            MclParameters(laser_model_type="beam_prob", **given)
        MclParameters(laser_model_type="beam", **given)


def test_unknown_names_are_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match=r"'max_particels' is unknown; did you mean max_particles"):
        MclParameters.from_dict({"max_particels": 100})
    with pytest.raises(InputError, match="did you mean likelihood_field"):
        MclParameters(laser_model_type="likelihod_field")


def test_lasers_that_look_up_beside_cones_have_no_table() -> None:
    """A table for each elevation of a depth camera takes gigabytes."""
    for name, wanted in (("service-robot", 0.0), ("polaroid-6500-ring", 0.1)):
        scanner = RangeScanner.from_preset(name)
        for settings in (settings_for(scanner), settings_for(scanner, "beam")):
            assert settings["beam_table_resolution"] == wanted
