"""Curves over the true range for bias and standard deviation of a calibration.

A curve is a plain number (constant), a `Polynomial` or a `Table`. In YAML:

    std: 0.03
    std: {polynomial: [0.01, 0.005]}          # lowest order first: 0.01 + 0.005 d
    std: {table: {range: [0.5, 4.0], value: [0.01, 0.04]}}
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import ConfigModel, Numbers, as_number, as_numbers, checked
from ambinav.runtime.array_types import Floats
from ambinav.runtime.errors import InputError


@dataclass(frozen=True)
class Polynomial:
    """Polynomial of the true range.

    Attributes:
        coefficients: Lowest order first, metres per metre to the power of the order.
    """

    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check the coefficients; raises `InputError` if one is not finite."""
        checked = as_numbers(self.coefficients, "polynomial")
        object.__setattr__(self, "coefficients", checked)

    def __call__(self, true_range: ArrayLike) -> Floats:
        """Return the value in metres at each true range, same shape."""
        d = np.asarray(true_range, dtype=np.float64)
        value = np.full(d.shape, self.coefficients[-1])
        for coefficient in reversed(self.coefficients[:-1]):
            value = value * d + coefficient
        return value

    def __str__(self) -> str:
        """Return the formula in d, metres."""
        powers = ["", " d", *(f" d^{k}" for k in range(2, len(self.coefficients)))]
        text = f"{self.coefficients[0]:.4g}"
        for c, power in zip(self.coefficients[1:], powers[1:], strict=False):
            text += f" {'-' if c < 0 else '+'} {abs(c):.4g}{power}"
        return text


@dataclass(frozen=True)
class Table:
    """Table over the true range, linear in between and constant beyond its ends.

    Attributes:
        ranges: True ranges in metres, increasing.
        values: The value in metres at each of them.
    """

    ranges: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check both columns; raises `InputError`."""
        ranges, values = as_numbers(self.ranges, "table range"), as_numbers(self.values, "value")
        if len(ranges) != len(values):
            raise InputError(
                f"table has {len(ranges)} ranges but {len(values)} values; give one value a range."
            )
        for before, after in pairwise(ranges):
            if not before < after:
                raise InputError(
                    f"table range {after} follows {before}; sort the ranges, each only once."
                )
        object.__setattr__(self, "ranges", ranges)
        object.__setattr__(self, "values", values)

    def __call__(self, true_range: ArrayLike) -> Floats:
        """Return the value in metres at each true range, same shape."""
        d = np.asarray(true_range, dtype=np.float64)
        return np.asarray(np.interp(d, self.ranges, self.values))

    def __str__(self) -> str:
        """Return the rows as range: value, metres."""
        rows = zip(self.ranges, self.values, strict=True)
        return "table {" + ", ".join(f"{d:.4g}: {v:.4g}" for d, v in rows) + "}"


Curve: TypeAlias = float | Polynomial | Table


class _TableModel(ConfigModel):
    range: Numbers
    value: Numbers


class _CurveModel(ConfigModel):
    polynomial: Numbers | None = None
    table: _TableModel | None = None


def as_curve(value: object, where: str) -> Curve:
    """Return a curve from a number, a curve or its YAML form; constants become floats.

    Raises:
        InputError: it is none of these or holds a value that is not finite.
    """
    if isinstance(value, dict):
        value = _from_mapping(value, where)
    if isinstance(value, Polynomial):
        return value.coefficients[0] if len(value.coefficients) == 1 else value
    return value if isinstance(value, Table) else as_number(value, where)


def _from_mapping(value: dict[object, object], where: str) -> Polynomial | Table:
    model = checked(_CurveModel, value, where)
    if model.polynomial is not None and model.table is None:
        return Polynomial(model.polynomial)
    if model.table is None or model.polynomial is not None:
        raise InputError(f"{where} is {value!r}; give either 'polynomial' or 'table'.")
    try:
        return Table(model.table.range, model.table.value)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def to_plain(curve: Curve) -> object:
    """Return the YAML form of a curve."""
    if isinstance(curve, Polynomial):
        return {"polynomial": list(curve.coefficients)}
    if isinstance(curve, Table):
        return {"table": {"range": list(curve.ranges), "value": list(curve.values)}}
    return curve


def evaluate(curve: Curve, true_range: ArrayLike) -> Floats:
    """Return the curve's value in metres at each true range (finite, metres), same shape."""
    if isinstance(curve, float):
        return np.full(np.shape(true_range), curve)
    return curve(true_range)


def lowest(curve: Curve, start: float, end: float) -> tuple[float, float]:
    """Return (true range, value) where the curve is lowest between two true ranges."""
    at = [start, end]
    if isinstance(curve, Table):
        at += [d for d in curve.ranges if start < d < end]
    elif isinstance(curve, Polynomial):
        slope = np.polynomial.Polynomial(curve.coefficients).deriv()
        turns = np.asarray(slope.trim().roots(), dtype=np.complex128).tolist()
        at += [d.real for d in turns if abs(d.imag) < 1e-9 and start < d.real < end]
    values = evaluate(curve, np.array(at))
    i = int(np.argmin(values))
    return at[i], float(values[i])
