"""Building blocks of report documents: strict parts, and numbers rounded for readers."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field


class Part(BaseModel):
    """An immutable part of a document with exactly the declared fields."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def rounded(digits: int) -> AfterValidator:
    """Return a validator that rounds to a number of digits and never gives minus zero."""
    return AfterValidator(lambda value: round(value, digits) + 0.0)


Metres = Annotated[float, rounded(3)]
SquareMetres = Annotated[float, rounded(2)]
Share = Annotated[float, rounded(4), Field(ge=0.0, le=1.0 + 1e-6)]
Degrees = Annotated[float, rounded(1)]
