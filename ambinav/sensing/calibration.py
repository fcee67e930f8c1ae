"""Calibration fit: bias and standard deviation from pairs of true range and reading."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from ambinav.runtime.array_types import Floats, Indices
from ambinav.runtime.errors import InputError, InputWarning
from ambinav.sensing.curves import Curve, Polynomial, Table, as_curve, evaluate
from ambinav.sensing.pairs import load_pairs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

StdModel: TypeAlias = Literal["constant", "linear", "table"]

# The mean of |e| of a normal deviate is sqrt(2 / pi) of its standard deviation.
STD_PER_MEAN_ABSOLUTE = math.sqrt(math.pi / 2)
HIGHEST_CHOSEN_DEGREE = 3
COVERAGE_WITHOUT_WARNING = 0.8
BEYOND = 0.1
"""Share of the range by which a reading may lie beyond it without a warning."""
FAR = 10.0
"""Deviations, by the median of the absolute errors, from which an error is warned of."""


@dataclass(frozen=True, eq=False)
class CalibrationFit:
    """Fitted calibration with its data.

    The deviation includes what the discretization of the readings adds: sqrt(std^2 +
    resolution^2 / 12). Where the resolution is below the deviation that is under 4 percent.

    Attributes:
        true_range: True ranges in metres, shape (n,).
        reading: Readings in metres, shape (n,).
        bias: Polynomial (or number) for the mean of reading - true range.
        std: Curve for the standard deviation about it.
        source: Where the pairs come from.
    """

    true_range: Floats
    reading: Floats
    bias: Curve
    std: Curve
    source: str

    @classmethod
    def fit(
        cls,
        pairs: str | Path | ArrayLike,
        *,
        limits: tuple[float, float],
        degree: int | None = 1,
        std_model: StdModel = "linear",
    ) -> CalibrationFit:
        """Fit the bias by least squares, then the deviation to the absolute residuals.

        Args:
            pairs: CSV file or array of shape (n, 2), see `load_pairs`.
            limits: The sensor's nearest and farthest range in metres.
            degree: Order of the bias polynomial; None: the one of 0 to 3 with the least
                Bayesian information criterion.
            std_model: "constant"; "linear", at least 0 at both limits; or "table", the root
                mean square of the residuals in bins of equally many pairs.

        Raises:
            InputError: the pairs cannot be used, are too few, or lie outside the limits.

        Warns:
            InputWarning: the pairs cover less than 80 percent of the sensor's range, or readings
                lie far beyond it, are 0, or differ much from the others at like ranges.
        """
        if std_model not in get_args(StdModel):
            names = ", ".join(get_args(StdModel))
            raise InputError(f"std_model is {std_model!r}; choose from {names}.")
        if degree is not None and (isinstance(degree, bool) or degree not in range(10)):
            raise InputError(f"degree is {degree!r}; give 0 to 9, or None to have it chosen.")
        values, source, places = load_pairs(pairs)
        _check_enough(values, source, 0 if degree is None else degree)
        d, reading = values[:, 0].copy(), values[:, 1].copy()
        _check_within(d, places, limits, source)
        # Noise carries some a little beyond it.
        beyond = reading > limits[1] + BEYOND * (limits[1] - limits[0])
        if beyond.any():
            warnings.warn(
                f"{source}: {beyond.sum()} of {len(reading)} readings lie far beyond max_range, "
                f"{limits[1]:g} m, and count as errors; remove them, or correct max_range.",
                InputWarning,
                stacklevel=3,
            )
        silent = (reading == 0.0) & (d > limits[0])
        if silent.any():
            warnings.warn(
                f"{source}: {silent.sum()} of {len(reading)} readings are 0, which many drivers "
                "report where there is no echo, and count as errors; remove them.",
                InputWarning,
                stacklevel=3,
            )
        error = reading - d
        odd = _outliers(d, error)
        odd = odd[~(beyond | silent)[odd]]
        if len(odd):
            worst = odd[np.abs(error[odd]).argmax()]
            warnings.warn(
                f"{source}: {len(odd)} of {len(reading)} readings differ from those at like ranges "
                f"by more than {FAR:g} of their deviations (the farthest: {reading[worst]:g} m at "
                f"{d[worst]:g} m) and count as errors; remove those without an echo, which many "
                "drivers report as max_range.",
                InputWarning,
                stacklevel=3,
            )
        if degree is None:
            degree = _best_degree(d, error)
        bias = _fit_polynomial(d, error, degree)
        residual = error - evaluate(bias, d)
        # Each fitted coefficient takes away the deviation of one pair.
        residual *= math.sqrt(len(d) / (len(d) - degree - 1))
        return cls(d, reading, bias, _fit_std(d, residual, std_model, limits), source)

    @property
    def residuals(self) -> Floats:
        """Residuals: reading - true range - fitted bias in metres, shape (n,)."""
        return self.reading - self.true_range - evaluate(self.bias, self.true_range)

    def report(self) -> str:
        """Return a table of the residuals over the true range, as text."""
        residual, std = self.residuals, evaluate(self.std, self.true_range)
        lines = [
            f"calibration from {self.source}: {len(residual)} pairs, true range "
            f"{self.true_range.min():.3f} to {self.true_range.max():.3f} m",
            f"bias(d) = {_formula(self.bias)}",
            f"std(d)  = {_formula(self.std)}",
            f"residuals: root mean square {1e3 * _rms(residual):.2f} mm, largest "
            f"{1e3 * np.abs(residual).max():.2f} mm, within 2 std "
            f"{100 * np.mean(np.abs(residual) <= 2 * std):.1f} % (normal: 95.4 %)",
            "",
            "   true range [m]  pairs  mean [mm]  std [mm]  fitted [mm]",
        ]
        for rows in _groups(self.true_range, 8):
            d, e = self.true_range[rows], residual[rows]
            lines.append(
                f"{f'{d.min():.3f} - {d.max():.3f}':>17}{len(d):>7}{1e3 * e.mean():>11.2f}"
                f"{1e3 * e.std():>10.2f}{1e3 * _rms(std[rows]):>13.2f}"
            )
        return "\n".join(lines) + "\n"

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw the residuals, millimetres, over the true range, with the fitted +-2 std."""
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots(figsize=(7, 4), layout="constrained")[1]
        d = np.linspace(self.true_range.min(), self.true_range.max(), 200)
        band = 2e3 * evaluate(self.std, d)
        ax.axhline(0.0, color="0.3", lw=0.8)
        ax.fill_between(d, -band, band, color="tab:blue", alpha=0.15, lw=0, label="fitted ±2 std")
        ax.plot(self.true_range, 1e3 * self.residuals, ".", ms=3, color="tab:blue", label="pairs")
        ax.set(xlabel="true range [m]", ylabel="reading - true range - bias [mm]")
        ax.set_title(f"bias(d) = {_formula(self.bias)}", fontsize=9)
        ax.legend(frameon=False)
        return ax


def _formula(curve: Curve) -> str:
    return (f"{curve:.4g}" if isinstance(curve, float) else str(curve)) + " m"


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _check_enough(values: Floats, source: str, degree: int) -> None:
    needed, distinct = degree + 4, len(np.unique(values[:, 0]))
    if len(values) < needed:
        raise InputError(
            f"{source}: {len(values)} pairs are too few for a bias of degree {degree}; give at "
            f"least {needed}."
        )
    if distinct <= degree:
        raise InputError(
            f"{source}: {distinct} different true ranges are too few for a bias of degree "
            f"{degree}; measure at more distances."
        )


def _check_within(d: Floats, places: list[str], limits: tuple[float, float], source: str) -> None:
    outside = np.flatnonzero((d < limits[0]) | (d > limits[1]))
    if len(outside):
        i = int(outside[0])
        raise InputError(
            f"{places[i]}: true_range is {d[i]:g}, outside the sensor's {limits[0]:g} to "
            f"{limits[1]:g} metres; remove the pair or change min_range or max_range."
        )
    if np.ptp(d) < COVERAGE_WITHOUT_WARNING * (limits[1] - limits[0]):
        warnings.warn(
            f"{source}: the pairs cover {d.min():g} to {d.max():g} of {limits[0]:g} to "
            f"{limits[1]:g} metres; the calibration is extrapolated over the rest.",
            InputWarning,
            stacklevel=4,
        )


def _fit_polynomial(d: Floats, error: Floats, degree: int) -> Curve:
    fitted = np.polynomial.Polynomial.fit(d, error, degree).convert().coef
    coefficients = [*fitted.tolist(), *[0.0] * (degree + 1 - len(fitted))]
    return as_curve(Polynomial(tuple(coefficients)), "bias")


def _best_degree(d: Floats, error: Floats) -> int:
    """Return the degree with the least Bayesian information criterion."""
    n, highest = len(d), min(HIGHEST_CHOSEN_DEGREE, len(np.unique(d)) - 1, len(d) - 4)
    scores = []
    for degree in range(highest + 1):
        # The floor, a nanometre, keeps readings without any deviation from deciding by rounding.
        rms = max(_rms(error - evaluate(_fit_polynomial(d, error, degree), d)), 1e-9)
        scores.append(2 * n * math.log(rms) + (degree + 1) * math.log(n))
    return int(np.argmin(scores))


def _fit_std(d: Floats, residual: Floats, model: StdModel, limits: tuple[float, float]) -> Curve:
    if model == "table" and np.ptp(d) > 0:
        groups = _groups(d, max(1, min(8, len(d) // 10)))
        at = tuple(float(d[rows].mean()) for rows in groups)
        return Table(at, tuple(_rms(residual[rows]) for rows in groups))
    if model == "constant" or np.ptp(d) == 0:
        return _rms(residual)
    start, end = limits
    far = (d - start) / (end - start)
    ends = _non_negative(np.column_stack([1.0 - far, far]), np.abs(residual))
    low, high = (STD_PER_MEAN_ABSOLUTE * v for v in ends)
    slope = (high - low) / (end - start)
    return as_curve(Polynomial((low - slope * start, slope)), "std")


def _non_negative(basis: Floats, target: Floats) -> tuple[float, float]:
    """Solve least squares for two non-negative weights, so that no deviation is negative."""
    first, second = np.linalg.lstsq(basis, target, rcond=None)[0].tolist()
    if first >= 0 and second >= 0:
        return first, second
    single = [float(column @ target / (column @ column)) for column in basis.T]
    return (0.0, single[1]) if first < 0 else (single[0], 0.0)


def _outliers(d: Floats, error: Floats) -> Indices:
    """Return the pairs whose errors differ far from the median of those at like true ranges."""
    odd = [
        rows[off > FAR * 1.4826 * max(float(np.median(off)), 1e-6)]
        for rows in _groups(d, 8)
        for off in (np.abs(error[rows] - np.median(error[rows])),)
    ]
    return np.concatenate(odd)


def _groups(d: Floats, most: int) -> list[Indices]:
    """Split pairs into groups of similar size by true range; equal ranges stay together."""
    edges = np.unique(np.quantile(d, np.linspace(0.0, 1.0, most + 1)))
    group = np.searchsorted(edges[1:-1], d, side="right")
    return [np.flatnonzero(group == g) for g in np.unique(group)]
