"""Parameters of Monte Carlo localization, with the names and defaults of nav2's AMCL."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from ambinav.config import (
    Count,
    NonNegative,
    Number,
    Positive,
    Share,
    Switch,
    check_fields,
    check_kind,
    choice,
    from_mapping,
    integer,
    require,
)
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.scanner_settings import settings_for
from ambinav.sensing.scanner import RangeScanner

LASER_MODELS = ("likelihood_field", "likelihood_field_prob", "beam", "beam_prob")
RESAMPLING = ("systematic", "low_variance", "multinomial")
ESTIMATES = ("cluster", "mean")
INTERPOLATIONS = ("nearest", "bilinear")
ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4", "alpha5")


@dataclass(frozen=True, kw_only=True)
class MclParameters:
    """Parameters of `MonteCarloLocalizer`; metres and radians.

    The first group are AMCL's (https://docs.nav2.org/configuration/packages/configuring-amcl.html),
    the second are our own. The defaults are AMCL's for any scanner; `for_scanner` returns those
    that suit a scanner.

    Attributes:
        alpha1: See `OdometryModel`, as the other four.
        alpha2: See there.
        alpha3: See there.
        alpha4: See there.
        alpha5: See there; a differential drive does not use it.
        laser_model_type: "likelihood_field" adds the cubes of the beams' likelihoods,
            "likelihood_field_prob" multiplies them; "beam" adds the cubes of the ray model's,
            "beam_prob" multiplies those (our own; AMCL has none).
        max_beams: Every (B - 1) // (max_beams - 1)-th of B beams is used, at least each.
        laser_max_range: Readings from here on are out of range; -1: the sensors' own limit.
        laser_min_range: Readings up to here are too near, and count as out of range; -1: the
            sensors' own limit.
        laser_likelihood_max_dist: Largest distance in the likelihood field.
        z_hit: Weight of hits.
        z_short: Weight of readings before the wall (beam model).
        z_max: Weight of readings that are out of range (beam model).
        z_rand: Weight of random readings.
        sigma_hit: Standard deviation of a hit, metres.
        lambda_short: Decay rate of readings before the wall, 1 / metres (beam model).
        min_particles: Minimum number of particles.
        max_particles: Maximum number of particles; filters start with this number.
        pf_err: Largest error between the true distribution and the particles' (KLD).
        pf_z: Upper standard normal quantile for it (as in AMCL, the number of deviations itself).
        update_min_d: Motion along x or y of the odometry frame from which the filter updates.
        update_min_a: Turn from which the filter updates.
        resample_interval: Number of updates per resampling.
        recovery_alpha_slow: Rate of the slow average of the likelihood; 0: no recovery. AMCL's
            documentation recommends 0.001.
        recovery_alpha_fast: Rate of the fast average; 0.1 is recommended with it.
        initial_cov_xx: Variance of the initial pose along x, square metres.
        initial_cov_yy: Along y.
        initial_cov_aa: Variance of its heading, square radians.
        importance_factor: Exponent of the product in "likelihood_field_prob" and "beam_prob", and
            of that over intensities (`ambinav.localization.intensity`): below 1 because
            neighbouring beams err together.
        resampling: "multinomial" draws each particle by itself, as AMCL does. The other two lay
            one comb of even teeth over the weights, shifted by one random number (Probabilistic
            Robotics, table 4.4), and differ in how they come to KLD's count: "low_variance"
            settles the number of teeth beforehand, from the bins that a first comb of
            max_particles teeth meets; "systematic" visits places in the order of van der
            Corput's sequence, which is nearly an even comb wherever it ends, and stops as AMCL
            does when enough particles for the bins met so far are drawn.
        estimate: "cluster": the mean of the heaviest cluster of particles, as in AMCL; "mean":
            that of all.
        recovery_reset: Whether both averages start anew after each update that put particles
            anywhere, as in AMCL: it then takes the low likelihood for the normal one and soon
            stops, and most robots that were carried away stay lost. If not, recovery goes on
            for as long as the likelihood stays low (Probabilistic Robotics, table 8.3), with at
            most a quarter of the particles at a time.
        likelihood_resolution: Spacing of the likelihood field, metres.
        beam_table_resolution: Spacing of a table of expected ranges for the ray model, metres,
            with which cones cost no more than lasers (see `range_table`); 0: every ray is cast.
        likelihood_interpolation: "nearest" point of the field, as in AMCL, or "bilinear".
        localizability_weighting: Degree, from 0 to 1, to which odometry alone determines directions
            that the scan does not constrain; true and false mean 1 and 0. Above 0 readings that do
            not come from the map are left out; z_hit, z_short, z_rand and lambda_short decide
            which. See `localizability_filter`, and docs/localizability.md for where it helps.

    Raises:
        InputError: a value makes no sense; one sentence names the parameter and the remedy.
    """

    alpha1: NonNegative = 0.2
    alpha2: NonNegative = 0.2
    alpha3: NonNegative = 0.2
    alpha4: NonNegative = 0.2
    alpha5: NonNegative = 0.2
    laser_model_type: Annotated[str, choice(LASER_MODELS)] = "likelihood_field"
    max_beams: Annotated[int, integer(least=2)] = 60
    laser_max_range: Number = 100.0
    laser_min_range: Number = -1.0
    laser_likelihood_max_dist: Positive = 2.0
    z_hit: Share = 0.5
    z_short: Share = 0.05
    z_max: Share = 0.05
    z_rand: Share = 0.5
    sigma_hit: Positive = 0.2
    lambda_short: Positive = 0.1
    min_particles: Count = 500
    max_particles: Count = 2000
    pf_err: Positive = 0.05
    pf_z: NonNegative = 0.99
    update_min_d: NonNegative = 0.25
    update_min_a: NonNegative = 0.2
    resample_interval: Count = 1
    recovery_alpha_slow: Share = 0.0
    recovery_alpha_fast: Share = 0.0
    initial_cov_xx: NonNegative = 0.25
    initial_cov_yy: NonNegative = 0.25
    initial_cov_aa: NonNegative = (math.pi / 12.0) ** 2

    importance_factor: Positive = 0.1
    resampling: Annotated[str, choice(RESAMPLING)] = "systematic"
    estimate: Annotated[str, choice(ESTIMATES)] = "cluster"
    recovery_reset: Switch = False
    likelihood_resolution: Positive = 0.025
    likelihood_interpolation: Annotated[str, choice(INTERPOLATIONS)] = "nearest"
    beam_table_resolution: NonNegative = 0.0
    localizability_weighting: Share = 0.0

    def __post_init__(self) -> None:
        """Check every parameter and convert it to its type."""
        if isinstance(self.localizability_weighting, bool):
            object.__setattr__(
                self, "localizability_weighting", float(self.localizability_weighting)
            )
        check_fields(self)
        most = f"at least min_particles ({self.min_particles})"
        require(self, "max_particles", self.max_particles >= self.min_particles, most)
        # Otherwise one reading that a model calls impossible rejects the whole scan.
        needed = {"likelihood_field_prob": ("z_rand",), "beam_prob": ("z_rand", "z_max")}
        for key in needed.get(self.laser_model_type, ()):
            require(self, key, getattr(self, key) > 0.0, "more than 0 where beams are multiplied")
        slow, fast = self.recovery_alpha_slow, self.recovery_alpha_fast
        low = "at most recovery_alpha_fast, or 0 for both"
        require(self, "recovery_alpha_slow", slow <= fast, low)

    @property
    def odometry(self) -> OdometryModel:
        """Odometry model of alpha1 to alpha5."""
        return OdometryModel(**{key: getattr(self, key) for key in ALPHAS})

    @classmethod
    def for_scanner(cls, scanner: RangeScanner, **given: Any) -> MclParameters:
        """Return the parameters for a scanner: see `scanner_settings.settings_for`.

        Args:
            scanner: The scanner.
            given: Parameters by name, which take precedence.

        Raises:
            InputError: a name is unknown, or a value makes no sense.
        """
        check_kind(scanner, RangeScanner, "scanner")
        return cls.from_dict({**settings_for(scanner, given.get("laser_model_type")), **given})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> MclParameters:
        """Read the parameters from a mapping, such as AMCL's block of a parameter file.

        Raises:
            InputError: a name is unknown (the nearest ones are offered), or a value makes no
                sense.
        """
        check_kind(values, Mapping, "values", "give a mapping of names to values")
        return from_mapping(cls, values)
