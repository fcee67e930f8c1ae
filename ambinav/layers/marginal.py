"""Conversion of information about x, y and theta to radii, with the heading marginalised."""

from __future__ import annotations

from ambinav.config import as_positive
from ambinav.geometry.principal_axes import principal_axes
from ambinav.layers.context import LayerContext
from ambinav.runtime.array_types import Floats


def marginal_radii(
    information: Floats, odometry_std: float, heading_std: float
) -> tuple[Floats, Floats, Floats]:
    """Compute the radii of the covariance of x and y after a scan, heading marginalised.

    Args:
        information: About x, y (1 / square metres) and theta (1 / square radians), map frame,
            shape (N, 3, 3).
        odometry_std: How well x and y are known beforehand, metres.
        heading_std: How well theta is, radians.

    Returns:
        Square roots of the larger and the smaller eigenvalue of the xy block of the inverse,
        metres, and the direction of the first, radians in [0, pi); each of shape (N,).
    """
    prior = odometry_std**-2.0
    f = information
    ftt = f[:, 2, 2] + heading_std**-2.0
    # Schur complement: what is left for x and y when theta is unknown.
    a = f[:, 0, 0] + prior - f[:, 0, 2] ** 2 / ftt
    b = f[:, 0, 1] - f[:, 0, 2] * f[:, 1, 2] / ftt
    c = f[:, 1, 1] + prior - f[:, 1, 2] ** 2 / ftt
    determinant = a * c - b * b
    return principal_axes(c / determinant, -b / determinant, a / determinant)


def prior_deviations(
    context: LayerContext, odometry_std: float | None, heading_std: float | None
) -> tuple[float, float]:
    """Return the prior deviations; by default those that the ambiguity model assumes.

    A place anywhere within the neighbourhood of radius R deviates by R / 2 along each axis, so
    where a scan tells nothing this layer and `major_radius` say the same.

    Raises:
        InputError: a deviation is not a positive number.
    """
    deviations = []
    for name, value, usual in (
        ("odometry_std", odometry_std, 0.5 * context.radius),
        ("heading_std", heading_std, context.model.sigma_theta),
    ):
        deviations.append(as_positive(usual if value is None else value, name))
    return deviations[0], deviations[1]
