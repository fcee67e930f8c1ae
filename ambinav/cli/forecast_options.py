"""Options of commands that forecast how a robot's localizer will do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, ClassVar

import typer

from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.forecast.forecast import Forecaster
    from ambinav.maps.ambiguity_map import AmbiguityMap


def _complete_localizer(begun: str) -> list[str]:
    """Return the calibrated classes of localizers that complete a partly typed name."""
    from ambinav.forecast.localizer_class import localizer_classes

    return [name for name in localizer_classes() if name.startswith(begun)]


def _complete_odometry(begun: str) -> list[str]:
    """Return the odometries that complete a partly typed name."""
    from ambinav.drive.odometries import ODOMETRIES

    return [name for name in ODOMETRIES if name.startswith(begun)]


@dataclass(frozen=True, kw_only=True)
class ForecastOptions:
    """Options on the localizer and the odometry of a forecast."""

    PANEL: ClassVar[str] = "Forecast"

    localizer: Annotated[
        str,
        typer.Option(
            "--localizer",
            metavar="NAME|FILE",
            help="Calibrated class of localizer: product, or a file.",
            autocompletion=_complete_localizer,
        ),
    ] = "product"
    odometry: Annotated[
        str,
        typer.Option(
            "--odometry",
            metavar="NAME",
            help="Odometry: good, mediocre, poor (2, 4.5 and 9 degrees off after a metre) or "
            "amcl-default (18).",
            autocompletion=_complete_odometry,
        ),
    ] = "mediocre"

    def check(self) -> None:
        """Refuse names that are unknown, before a map is opened.

        Raises:
            InputError: there is one.
        """
        from ambinav.drive.odometries import odometry_of
        from ambinav.forecast.localizer_class import LocalizerClass

        for option, check, value in (
            ("--localizer", LocalizerClass.load, self.localizer),
            ("--odometry", odometry_of, self.odometry),
        ):
            try:
                check(value)
            except InputError as error:
                raise InputError(f"{option}: {error}") from None

    def forecaster(self, amap: AmbiguityMap) -> Forecaster:
        """Make the forecaster of a map."""
        from ambinav.forecast.forecast import Forecaster

        return Forecaster(amap, self.odometry, self.localizer)
