"""Range sensor: conversion of a true range to a discretized reading."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import NoneType
from typing import Any

import numpy as np
import yaml
from numpy.typing import ArrayLike

from ambinav.config import (
    as_array,
    as_number,
    check_generator,
    check_kind,
    from_mapping,
    parse_yaml,
    read_text,
)
from ambinav.runtime.array_types import Floats, Floats32, Indices
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import write_text
from ambinav.runtime.input_suggestions import SENSOR, kind_of, refuse
from ambinav.sensing import curves
from ambinav.sensing.calibration import CalibrationFit, StdModel
from ambinav.sensing.curves import Curve
from ambinav.sensing.intensity import Intensity
from ambinav.sensing.sensor_file import parse_sensor, render_sensor
from ambinav.sensing.sensor_models import SENSOR_MODELS

MOST_BINS = 10_000_000
NUMBERS = ("aperture", "min_range", "max_range", "resolution", "random_share", "lost_share")


@dataclass(frozen=True, kw_only=True)
class RangeSensor:
    """Range sensor and its calibration; lengths in metres, angles in radians.

    The true range of a sensor with a cone is the smallest over the rays in its cone that return
    an echo. A true range becomes a reading in three steps: the calibration moves it by the bias
    and a normal deviation; the value falls into one of `bins` bins of `resolution` between
    `min_range` and `max_range`; a share of the readings is random (any bin) or lost (no echo).
    A reading is the centre of its bin, and as in ROS REP 117 -inf is "too near" and +inf is
    "no echo".

    Attributes:
        name: Name in messages and reports.
        aperture: Full angle of the perception cone, 0 (a laser) up to below pi.
        min_range: Smallest distance that is measured.
        max_range: Largest distance that is measured.
        resolution: Step of the discretized value.
        bias: Mean of reading minus true range: a number or a curve over the true range.
        std: Standard deviation of the reading: a number or a curve over the true range.
        max_incidence: Largest angle between ray and surface normal that still returns an echo;
            None: every angle does.
        random_share: Share of readings that fall into any bin, whatever the true range.
        lost_share: Share of readings that are "no echo", whatever the true range.
        intensity: Intensity channel, or None; lasers only.
        source: Source of the figures.
        calibration: The fit that bias and std come from, with its residuals, or None. It is
            kept out of equality and YAML.

    Raises:
        InputError: a field has an invalid value; the message gives its name and the reason.
    """

    name: str = ""
    aperture: float = 0.0
    min_range: float = 0.0
    max_range: float
    resolution: float
    bias: Curve = 0.0
    std: Curve
    max_incidence: float | None = None
    random_share: float = 0.01
    lost_share: float = 0.0
    intensity: Intensity | None = None
    source: str = ""
    calibration: CalibrationFit | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        """Check every field and convert it to its type."""
        place = f"sensor {self.name!r}: " if self.name else "sensor: "
        for key in NUMBERS:
            object.__setattr__(self, key, as_number(getattr(self, key), place + key))
        check_kind(self.intensity, (Intensity, NoneType), place + "intensity")
        for key in ("bias", "std"):
            object.__setattr__(self, key, curves.as_curve(getattr(self, key), place + key))
        if self.max_incidence is not None:
            limit = as_number(self.max_incidence, place + "max_incidence")
            object.__setattr__(self, "max_incidence", limit)
        try:
            _check(self)
        except InputError as error:
            raise InputError(f"{place}{error}") from None

    @property
    def bins(self) -> int:
        """Number K of bins; the last one is narrower where the resolution does not divide."""
        return max(1, math.ceil((self.max_range - self.min_range) / self.resolution - 1e-6))

    @cached_property
    def edges(self) -> Floats:
        """Edges of the bins in metres, shape (K + 1,), from `min_range` to `max_range`."""
        edges = self.min_range + self.resolution * np.arange(self.bins + 1, dtype=np.float64)
        edges[-1] = self.max_range
        edges.flags.writeable = False
        return edges

    def bias_at(self, true_range: ArrayLike) -> Floats:
        """Return the bias in metres at each true range; held constant beyond the limits."""
        return curves.evaluate(self.bias, self._within(true_range))

    def std_at(self, true_range: ArrayLike) -> Floats:
        """Return the deviation in metres at each true range; held constant beyond the limits."""
        value = curves.evaluate(self.std, self._within(true_range))
        return np.asarray(np.maximum(value, 0.0), dtype=np.float64)

    def _within(self, true_range: ArrayLike) -> Floats:
        d = np.asarray(true_range, dtype=np.float64)
        return np.clip(d, self.min_range, self.max_range)

    def reading_probabilities(self, true_range: ArrayLike) -> Floats:
        """Return P(reading | true range) for every reading.

        Args:
            true_range: Metres, any shape; inf where nothing returns an echo.

        Returns:
            Shape (..., K + 2), columns "too near", bins 0 to K - 1, "no echo"; each row sums to
            1. At inf everything but the random share is "no echo".

        Raises:
            InputError: a true range is NaN or negative.
        """
        from scipy.special import ndtr  # takes a third of a second: only when asked for

        d = _true_ranges(true_range)[..., None]
        mean, std = d + self.bias_at(d), self.std_at(d)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            below = np.where(std > 0, ndtr((self.edges - mean) / std), mean < self.edges)
        row = np.empty((*d.shape[:-1], self.bins + 2))
        row[..., 0] = below[..., 0]
        np.subtract(below[..., 1:], below[..., :-1], out=row[..., 1:-1])
        row[..., -1] = 1.0 - below[..., -1]
        row *= 1.0 - self.random_share - self.lost_share
        row[..., 1:-1] += self.random_share / self.bins
        row[..., -1] += self.lost_share
        return row

    def read(self, true_range: ArrayLike, rng: np.random.Generator) -> Floats32:
        """Simulate one reading of each true range.

        Args:
            true_range: Metres, any shape; inf where nothing returns an echo.
            rng: The source of randomness.

        Returns:
            float32, same shape: the centre of the bin in metres, -inf too near, inf no echo.

        Raises:
            InputError: a true range is NaN or negative, or `rng` is no Generator.
        """
        check_generator(rng)
        d = _true_ranges(true_range)
        value = d + self.bias_at(d) + self.std_at(d) * rng.standard_normal(d.shape)
        too_near, no_echo = value < self.min_range, value >= self.max_range
        # The position within the range, in bins; the echoless ones are overwritten below.
        position = np.where(no_echo, 0.0, (value - self.min_range) / self.resolution)
        chance = rng.random(d.shape)
        if self.random_share > 0:
            # Given that it is below the share, chance / share is itself uniform on [0, 1).
            odd = chance < self.random_share
            position = np.where(odd, chance * (self.bins / self.random_share), position)
            too_near, no_echo = too_near & ~odd, no_echo & ~odd
            no_echo |= ~odd & (chance < self.random_share + self.lost_share)
        else:
            no_echo |= chance < self.lost_share
        lower = self.min_range + self.resolution * np.minimum(np.floor(position), self.bins - 1)
        centre = 0.5 * (lower + np.minimum(lower + self.resolution, self.max_range))
        reading = np.where(no_echo, np.inf, np.where(too_near, -np.inf, centre))
        return np.asarray(reading, dtype=np.float32)

    def column(self, reading: ArrayLike) -> Indices:
        """Return the column of `reading_probabilities` that each reading (metres) falls into.

        Raises:
            InputError: a reading is NaN.
        """
        r = np.asarray(reading, dtype=np.float64)
        if np.isnan(r).any():
            raise InputError("reading is NaN; use inf for no echo and -inf for too near.")
        # The tiny shift lets readings at an edge, written with few decimals, fall above it.
        step = np.floor((r - self.min_range) / self.resolution + 1e-6)
        step = np.where(r > self.max_range, self.bins, np.clip(step, -1, self.bins - 1))
        return np.asarray(step + 1, dtype=np.intp)

    @classmethod
    def fit(
        cls,
        pairs: str | Path | ArrayLike,
        *,
        max_range: float,
        resolution: float,
        min_range: float = 0.0,
        degree: int | None = 1,
        std_model: StdModel = "linear",
        **fields: Any,
    ) -> RangeSensor:
        """Fit bias and deviation to measured pairs; `.calibration` shows the residuals.

        Args:
            pairs: A CSV file with the columns true_range and reading, or an array of shape
                (n, 2) with the same columns, metres.
            max_range: As in the class.
            resolution: As in the class.
            min_range: As in the class.
            degree: Order of the bias polynomial; None chooses 0 to 3 by the Bayesian
                information criterion.
            std_model: Form of the deviation: "constant", "linear" or "table".
            **fields: Further fields of the class: name, aperture, random_share ...

        Raises:
            InputError: the pairs cannot be used; the sentence names file, line and value.
        """
        limits = (as_number(min_range, "min_range"), as_number(max_range, "max_range"))
        if not 0 <= limits[0] < limits[1]:
            raise InputError(
                f"max_range is {max_range}; it must exceed min_range ({min_range}, at least 0)."
            )
        fit = CalibrationFit.fit(pairs, limits=limits, degree=degree, std_model=std_model)
        return cls(
            min_range=min_range,
            max_range=max_range,
            resolution=resolution,
            bias=fit.bias,
            std=fit.std,
            calibration=fit,
            **{"source": f"fitted to {fit.source}", **fields},
        )

    @classmethod
    def from_yaml(cls, path: str | Path) -> RangeSensor:
        """Read a sensor from a YAML file; angles in the `_deg` fields are degrees.

        Raises:
            InputError: the file or a field cannot be used.
        """
        path = Path(path)
        example = "`ambinav calibrate sensor` writes one"
        plain = parse_yaml(read_text(path), str(path), example)
        refuse(str(path), kind_of(plain), "a sensor", SENSOR)
        return cls.from_plain(plain, str(path))

    @classmethod
    def from_plain(cls, plain: object, where: str) -> RangeSensor:
        """Make a sensor from parsed YAML; `where` names its location in messages.

        With the key `model`, a sensor model makes it (`sensor_models`), of the other keys.

        Raises:
            InputError: a field or the model is of no use, or the model is a plug-in's and fails.
        """
        if isinstance(plain, Mapping) and "model" in plain:
            return _modelled(dict(plain), where)
        values = parse_sensor(plain, where)
        try:
            return cls(**values)
        except InputError as error:
            raise InputError(f"{where}: {str(error).removeprefix('sensor: ')}") from error

    def to_plain(self) -> dict[str, object]:
        """Return the YAML form as a mapping."""
        return render_sensor(vars(self))

    def to_yaml(self, path: str | Path | None = None) -> str:
        """Return the sensor as YAML text, and write it to `path` if one is given."""
        text = yaml.safe_dump(self.to_plain(), sort_keys=False, allow_unicode=True)
        if path is not None:
            write_text(Path(path), text)
        return text


def _modelled(plain: dict[str, Any], where: str) -> RangeSensor:
    name = str(plain.pop("model"))
    try:
        model = SENSOR_MODELS.get(name)
        with SENSOR_MODELS.calling(name):
            sensor = model.make(from_mapping(model.parameters, plain))
            if not isinstance(sensor, RangeSensor):
                raise TypeError(f"it is not a RangeSensor but {sensor!r}")
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    return sensor


def _true_ranges(values: ArrayLike) -> Floats:
    d = as_array(values, "true range", "metres of at least 0, or inf for no echo")
    usable = d >= 0
    if not usable.all():
        raise InputError(
            f"true range is {d[~usable].flat[0]}; give metres of at least 0, or inf for no echo."
        )
    return d


def _require(good: bool, sentence: str) -> None:
    if not good:
        raise InputError(sentence)


def _check(s: RangeSensor) -> None:
    """Raise `InputError` for the first field with an invalid value."""
    _require(s.min_range >= 0, f"min_range is {s.min_range}; give at least 0 metres.")
    _require(
        s.max_range > s.min_range,
        f"max_range is {s.max_range}; it must exceed min_range ({s.min_range}).",
    )
    span = s.max_range - s.min_range
    _require(
        0 < s.resolution <= span,
        f"resolution is {s.resolution}; give more than 0 and at most the span of the sensor, "
        f"{span:g} metres.",
    )
    _require(
        span / s.resolution <= MOST_BINS,
        f"resolution is {s.resolution}, which makes more than {MOST_BINS} bins of {span:g} metres; "
        "give a coarser one.",
    )
    _require(
        0 <= s.aperture < math.pi,
        f"aperture is {math.degrees(s.aperture):g} degrees; give the full angle of the cone, 0 to "
        "below 180 (0: a laser).",
    )
    _require(
        s.max_incidence is None or 0 < s.max_incidence <= math.pi / 2,
        f"max_incidence is {math.degrees(s.max_incidence or 0.0):g} degrees; give more than 0 and "
        "at most 90, or leave it out.",
    )
    _require(
        s.intensity is None or s.aperture == 0.0,
        f"intensity is given with an aperture of {math.degrees(s.aperture):g} degrees; give it for "
        "a laser, of which an echo comes from one surface, or leave it out.",
    )
    for key, share in (("random_share", s.random_share), ("lost_share", s.lost_share)):
        _require(0 <= share < 1, f"{key} is {share}; give a share of at least 0 and below 1.")
    total = s.random_share + s.lost_share
    _require(total < 1, f"random_share + lost_share is {total:g}; together they must be below 1.")
    where, least = curves.lowest(s.std, s.min_range, s.max_range)
    _require(
        least >= -1e-12,
        f"std is {least:g} at a true range of {where:g} metres; it must be at least 0 from "
        "min_range to max_range.",
    )
