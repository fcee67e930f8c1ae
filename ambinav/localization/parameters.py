"""The parameters of Monte Carlo localization, by the names and with the defaults of nav2's AMCL."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from ambinav.config import as_count, as_number, nearest
from ambinav.errors import InputError
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.scanner_settings import FIELDS, settings_for

if TYPE_CHECKING:
    from ambinav.sensing.scanner import RangeScanner

LASER_MODELS = ("likelihood_field", "likelihood_field_prob", "beam", "beam_prob")
RESAMPLING = ("systematic", "low_variance", "multinomial")
ESTIMATES = ("cluster", "mean")
INTERPOLATIONS = ("nearest", "bilinear")
CHOICES = {
    "laser_model_type": LASER_MODELS,
    "resampling": RESAMPLING,
    "estimate": ESTIMATES,
    "likelihood_interpolation": INTERPOLATIONS,
}
COUNTS = ("max_beams", "min_particles", "max_particles", "resample_interval")
# Lowest value of each number, and whether it may be taken.
POSITIVE = (
    "pf_err", "sigma_hit", "lambda_short", "laser_likelihood_max_dist", "likelihood_resolution",
    "importance_factor",
)  # fmt: skip
SHARES = (
    "z_hit", "z_short", "z_max", "z_rand", "recovery_alpha_slow", "recovery_alpha_fast",
    "localizability_weighting",
)  # fmt: skip
AT_LEAST_ZERO = (
    "pf_z", "update_min_d", "update_min_a", "initial_cov_xx", "initial_cov_yy", "initial_cov_aa",
    "beam_table_resolution",
)  # fmt: skip
ALPHAS = ("alpha1", "alpha2", "alpha3", "alpha4", "alpha5")


@dataclass(frozen=True, kw_only=True)
class MclParameters:
    """Parameters of `MonteCarloLocalizer`; metres and radians.

    The first group are AMCL's (https://docs.nav2.org/configuration/packages/configuring-amcl.html),
    the second are our own. The defaults are AMCL's for any scanner; `for_scanner` has those that
    suit one.

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
        z_short: Weight of what stands before the wall (beam model).
        z_max: Weight of readings that are out of range (beam model).
        z_rand: Weight of readings that are just anything.
        sigma_hit: Standard deviation of a hit, metres.
        lambda_short: Decay of what stands before the wall, 1 / metres (beam model).
        min_particles: Fewest particles.
        max_particles: Most particles; filters start with so many.
        pf_err: Largest error between the true distribution and the particles' (KLD).
        pf_z: Upper standard normal quantile for it (as in AMCL, the number of deviations itself).
        update_min_d: Motion along x or y of the odometry frame from which on the filter updates.
        update_min_a: Turn from which on it updates.
        resample_interval: Updates for each resampling.
        recovery_alpha_slow: Rate of the slow average of the likelihood; 0: no recovery. AMCL's
            documentation recommends 0.001.
        recovery_alpha_fast: Rate of the fast average; 0.1 is recommended with it.
        initial_cov_xx: Variance of the initial pose along x, square metres.
        initial_cov_yy: Along y.
        initial_cov_aa: Of its heading, square radians.
        importance_factor: Exponent of the product in "likelihood_field_prob" and "beam_prob":
            below 1 because neighbouring beams err together.
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
        localizability_weighting: How far to leave to odometry what the scan cannot tell, from 0,
            not at all, to 1; true and false stand for 1 and 0. Above 0 readings that are not of
            the map are left out, whatever the number; z_hit, z_short, z_rand and lambda_short say
            which. See `localizability_filter`, and docs/localizability.md for where it helps.

    Raises:
        InputError: a value makes no sense; one sentence names the parameter and the remedy.
    """

    alpha1: float = 0.2
    alpha2: float = 0.2
    alpha3: float = 0.2
    alpha4: float = 0.2
    alpha5: float = 0.2
    laser_model_type: str = "likelihood_field"
    max_beams: int = 60
    laser_max_range: float = 100.0
    laser_min_range: float = -1.0
    laser_likelihood_max_dist: float = 2.0
    z_hit: float = 0.5
    z_short: float = 0.05
    z_max: float = 0.05
    z_rand: float = 0.5
    sigma_hit: float = 0.2
    lambda_short: float = 0.1
    min_particles: int = 500
    max_particles: int = 2000
    pf_err: float = 0.05
    pf_z: float = 0.99
    update_min_d: float = 0.25
    update_min_a: float = 0.2
    resample_interval: int = 1
    recovery_alpha_slow: float = 0.0
    recovery_alpha_fast: float = 0.0
    initial_cov_xx: float = 0.25
    initial_cov_yy: float = 0.25
    initial_cov_aa: float = (math.pi / 12.0) ** 2

    importance_factor: float = 0.1
    resampling: str = "systematic"
    estimate: str = "cluster"
    recovery_reset: bool = False
    likelihood_resolution: float = 0.025
    likelihood_interpolation: str = "nearest"
    beam_table_resolution: float = 0.0
    localizability_weighting: float = 0.0

    def __post_init__(self) -> None:
        """Check every parameter and bring it to its type."""
        for key, choices in CHOICES.items():
            value = getattr(self, key)
            if value not in choices:
                raise InputError(f"{key} is {value!r}; {nearest(str(value), choices)}.")
        if not isinstance(self.recovery_reset, bool):
            raise InputError(f"recovery_reset is {self.recovery_reset!r}; give true or false.")
        if isinstance(self.localizability_weighting, bool):
            object.__setattr__(
                self, "localizability_weighting", float(self.localizability_weighting)
            )
        for key in COUNTS:
            object.__setattr__(self, key, as_count(getattr(self, key), key))
        numbers = ("laser_max_range", "laser_min_range")
        for key in (*POSITIVE, *SHARES, *AT_LEAST_ZERO, *numbers, *ALPHAS):
            object.__setattr__(self, key, as_number(getattr(self, key), key))
        for key in POSITIVE:
            self._require(key, getattr(self, key) > 0.0, "more than 0")
        for key in AT_LEAST_ZERO:
            self._require(key, getattr(self, key) >= 0.0, "at least 0")
        for key in SHARES:
            self._require(key, 0.0 <= getattr(self, key) <= 1.0, "0 to 1")
        self._require("max_beams", self.max_beams >= 2, "at least 2 beams")
        most = f"at least min_particles ({self.min_particles})"
        self._require("max_particles", self.max_particles >= self.min_particles, most)
        # Else one reading that a model holds impossible takes the whole scan away.
        needed = {"likelihood_field_prob": ("z_rand",), "beam_prob": ("z_rand", "z_max")}
        for key in needed.get(self.laser_model_type, ()):
            self._require(key, getattr(self, key) > 0.0, "more than 0 where beams are multiplied")
        slow, fast = self.recovery_alpha_slow, self.recovery_alpha_fast
        low = "at most recovery_alpha_fast, or 0 for both"
        self._require("recovery_alpha_slow", slow <= fast, low)
        self.odometry  # noqa: B018 - it checks the alphas

    def _require(self, key: str, good: bool, what: str) -> None:
        if not good:
            raise InputError(f"{key} is {getattr(self, key)}; give {what}.")

    @property
    def odometry(self) -> OdometryModel:
        """The odometry model of alpha1 to alpha5."""
        return OdometryModel(**{key: getattr(self, key) for key in ALPHAS})

    @property
    def uses_field(self) -> bool:
        """Whether the scan is weighed by a likelihood field; if not, by expected ranges."""
        return self.laser_model_type in FIELDS

    @classmethod
    def for_scanner(cls, scanner: RangeScanner, **given: Any) -> MclParameters:
        """The parameters that suit a scanner: see `scanner_settings.settings_for`.

        Args:
            scanner: The scanner.
            given: Parameters by name, which stand whatever the scanner.

        Raises:
            InputError: a name is unknown, or a value makes no sense.
        """
        return cls.from_dict({**settings_for(scanner, given.get("laser_model_type")), **given})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> MclParameters:
        """Take the parameters from a mapping, such as AMCL's block of a parameter file.

        Raises:
            InputError: a name is unknown (the nearest ones are offered), or a value makes no
                sense.
        """
        known = [field.name for field in fields(cls)]
        for key in values:
            if key not in known:
                raise InputError(
                    f"localizer: the parameter {key!r} is unknown; {nearest(str(key), known)}."
                )
        return cls(**values)
