"""Building blocks of report documents: strict parts, and numbers rounded for readers."""

from __future__ import annotations

import math
from typing import Annotated, Any, Final, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

UNITS: Final = ("deg", "m", "m2", "ms", "points")
"""Ends of the names of fields."""


class Part(BaseModel):
    """An immutable part of a document with exactly the declared fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @classmethod
    def of(cls, record: object, **values: Any) -> Self:
        """Return the part of a record: each field that is not given has the value it has there.

        The record's name of a value lacks the unit: `x_m` is read from `x`, `area_m2` from `area`.
        Angles of records are in radians: `turn_deg` is `turn` in degrees.
        """
        for field in cls.model_fields.keys() - values.keys():
            name, _, unit = field.rpartition("_")
            if hasattr(record, field):
                values[field] = getattr(record, field)
            elif unit in UNITS and hasattr(record, name):
                value = getattr(record, name)
                is_angle = unit == "deg" and value is not None
                values[field] = math.degrees(value) if is_angle else value
        return cls(**values)


def rounded(digits: int) -> AfterValidator:
    """Return a validator that rounds to a number of digits and never gives minus zero."""
    return AfterValidator(lambda value: round(value, digits) + 0.0)


Metres = Annotated[float, rounded(3)]
SquareMetres = Annotated[float, rounded(2)]
Share = Annotated[float, rounded(4), Field(ge=0.0, le=1.0 + 1e-6)]
Degrees = Annotated[float, rounded(1)]
