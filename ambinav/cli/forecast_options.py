"""Options of commands that forecast how a robot's localizer will do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import radians
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import typer

from ambinav.cli.checks import option_name
from ambinav.cli.limits import above_zero
from ambinav.cli.options import completing
from ambinav.forecasting.document import LOCALIZER, ODOMETRY
from ambinav.runtime.errors import InputError

if TYPE_CHECKING:
    from ambinav.forecasting.forecast import Forecaster
    from ambinav.maps.ambiguity_map import AmbiguityMap
    from ambinav.routes.route import Route


_complete_localizer = completing(
    "ambinav.forecasting.localizer_class", lambda module: module.localizer_classes()
)
_complete_odometry = completing("ambinav.drive.odometries", lambda module: module.ODOMETRIES)


@dataclass(frozen=True, kw_only=True)
class LocalizerOptions:
    """Options on the localizer and the odometry of a forecast.

    Attributes:
        localizer (NAME|FILE): Calibrated class of localizer: product, amcl (lasers), or a file.
        odometry (NAME): Odometry: good, mediocre, poor (2, 4.5 and 9 degrees off after a metre) or
            amcl-default (18).
    """

    PANEL: ClassVar[str] = "Forecast"

    localizer: Annotated[
        str | None, typer.Option(show_default=LOCALIZER, autocompletion=_complete_localizer)
    ] = None
    odometry: Annotated[
        str | None, typer.Option(show_default=ODOMETRY, autocompletion=_complete_odometry)
    ] = None

    @property
    def names(self) -> dict[str, Any]:
        """Localizer and odometry, as arguments of a forecast."""
        return {
            "localizer": LOCALIZER if self.localizer is None else self.localizer,
            "odometry": ODOMETRY if self.odometry is None else self.odometry,
        }

    def check(self) -> None:
        """Refuse names that are unknown, before a map is opened.

        Raises:
            InputError: a value or a combination of options cannot be used.
        """
        from ambinav.drive.odometries import odometry_of
        from ambinav.forecasting.localizer_class import LocalizerClass

        for name, check in (("localizer", LocalizerClass.load), ("odometry", odometry_of)):
            try:
                check(self.names[name])
            except InputError as error:
                raise InputError(f"--{name}: {error}") from None


@dataclass(frozen=True, kw_only=True)
class ForecastOptions(LocalizerOptions):
    """Options on the localizer, the odometry and the limits of a forecast.

    Attributes:
        position_limit (M): A robot is lost that is farther off, metres. [default: 0.5]
        lateral_limit (M): A robot is lost that is farther off across its heading, as on a lane;
            --position-limit then holds along the heading. [default: none]
        heading_limit (DEG): A robot is lost that is turned by more, degrees. [default: 30]
    """

    position_limit: Annotated[float | None, above_zero("1.2")] = None
    lateral_limit: Annotated[float | None, above_zero("0.3")] = None
    heading_limit: Annotated[float | None, above_zero("15", "degrees")] = None

    @property
    def is_given(self) -> bool:
        """True if any of the options is given."""
        return bool(self.given_options)

    @property
    def given_options(self) -> list[str]:
        """Names of the options that are given."""
        return [
            option_name(each.name) for each in fields(self) if getattr(self, each.name) is not None
        ]

    def check_no_program(self) -> None:
        """Refuse a localizer that drives would start as a program.

        Raises:
            InputError: it is one.
        """
        from ambinav.forecasting.localizer_class import LocalizerClass

        localizer = LocalizerClass.load(self.names["localizer"])
        if localizer.runs_command:
            raise InputError(
                f"--localizer: drives of {localizer.title} would run a program with your rights; "
                "give a class of ambinav's own localizers."
            )

    def forecaster(
        self, amap: AmbiguityMap, routes: Sequence[Route] | None = None, **overrides: Any
    ) -> Forecaster:
        """Make the forecaster of a map.

        Args:
            amap: The map.
            routes: See `Forecaster`.
            overrides: Further arguments of it, in the place of these options.
        """
        from ambinav.forecasting.forecast import Forecaster

        limits: dict[str, Any] = {
            "position_limit": self.position_limit,
            "lateral_limit": self.lateral_limit,
            "heading_limit": None if self.heading_limit is None else radians(self.heading_limit),
        }
        limits_given = {name: limit for name, limit in limits.items() if limit is not None}
        return Forecaster(amap, routes=routes, **{**self.names, **limits_given, **overrides})
