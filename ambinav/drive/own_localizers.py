"""Built-in localizers as entries of the registry; each is imported when it is made."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ambinav.config import NonNegative, Positive, check_fields
from ambinav.drive.localizer_spec import LocalizerContext, LocalizerSpec, Motion
from ambinav.drive.localizers import DeadReckoning, Localizer
from ambinav.localization.odometry import OdometryModel
from ambinav.localization.parameters import ALPHAS, MclParameters
from ambinav.localization.scanner_settings import settings_for, unsuited


@dataclass(frozen=True)
class EkfParameters:
    """Parameters of `ExtendedKalmanFilter`, which uses every scan.

    Attributes:
        alpha1: See `OdometryModel`, as the other four.
        alpha2: See there.
        alpha3: See there.
        alpha4: See there.
        alpha5: See there.
        map_std: Deviation of the map's walls, metres; None: `Environment.map_std`.
        gate: Beams that deviate by more than this number of deviations are left out.

    Raises:
        InputError: a value makes no sense.
    """

    alpha1: NonNegative = 0.2
    alpha2: NonNegative = 0.2
    alpha3: NonNegative = 0.2
    alpha4: NonNegative = 0.2
    alpha5: NonNegative = 0.2
    map_std: NonNegative | None = None
    gate: Positive = 3.0

    def __post_init__(self) -> None:
        """Check what the filter would otherwise only check when it is made."""
        check_fields(self)

    @property
    def odometry(self) -> OdometryModel:
        """Odometry model of alpha1 to alpha5."""
        return OdometryModel(**{key: getattr(self, key) for key in ALPHAS})


def monte_carlo(parameters: MclParameters, context: LocalizerContext) -> Localizer:
    """Make a Monte Carlo localizer."""
    from ambinav.localization.mcl import MonteCarloLocalizer

    return MonteCarloLocalizer(
        context.environment, context.scanner, parameters, runs=context.runs, rng=context.rng
    )


def _kalman(parameters: EkfParameters, context: LocalizerContext) -> Localizer:
    from ambinav.localization.ekf import ExtendedKalmanFilter

    return ExtendedKalmanFilter(
        context.environment,
        context.scanner,
        parameters.odometry,
        runs=context.runs,
        map_std=parameters.map_std,
        gate=parameters.gate,
    )


def alphas(model: OdometryModel) -> dict[str, float]:
    """Return the variances of a differential drive by name."""
    return {name: getattr(model, name) for name in ALPHAS if name != "alpha5"}


def _alphas_between_updates(motion: Motion) -> dict[str, float]:
    """Return odometry variances over the motion between two localization updates."""
    return alphas(motion.noise.modelled)


def _alphas_between_scans(motion: Motion) -> dict[str, float]:
    """Return odometry variances between two scans at the robot's maximum speed."""
    robot, rate = motion.robot, motion.rate
    return alphas(motion.noise.modelled_every(robot.max_speed / rate, robot.max_turn_rate / rate))


def _model(parameters: MclParameters) -> str:
    model = parameters.laser_model_type
    power = f" to the power {parameters.importance_factor:g}" if model.endswith("_prob") else ""
    return f"{model}{power}"


MCL = LocalizerSpec(
    name="mcl",
    title="Monte Carlo localization",
    make=monte_carlo,
    parameters=MclParameters,
    detail=_model,
    defaults=_alphas_between_updates,
    suited=lambda scanner, given: settings_for(scanner, given.get("laser_model_type")),
    note=lambda parameters, scanner: unsuited(parameters.laser_model_type, scanner),
)
"""Monte Carlo localization with what suits the scanner."""

AMCL = replace(MCL, name="amcl", suited=LocalizerSpec.suited)
"""Monte Carlo localization with the defaults of AMCL, for any scanner."""

EKF = LocalizerSpec(
    name="ekf",
    title="a Kalman filter on the ranges of every scan",
    make=_kalman,
    parameters=EkfParameters,
    defaults=_alphas_between_scans,
)

PERFECT = LocalizerSpec(name="perfect", title="the truth", make=lambda parameters, context: None)

ODOMETRY = LocalizerSpec(
    name="odometry",
    title="dead reckoning",
    make=lambda parameters, context: DeadReckoning(context.noise, context.runs),
)
