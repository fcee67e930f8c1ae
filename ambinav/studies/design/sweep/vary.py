"""Variations of a sweep: `aperture=60:360:30` as values, and each value as a scanner."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from ambinav.config import nearest
from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Layout, Mounts, Part, Planar, Ring
from ambinav.sensing.scanner import RangeScanner
from ambinav.sensing.space_layout import AtPoint, Camera, Layers
from ambinav.sensing.tilting_layout import Tilting

MOST_SETTINGS: Final = 2000
"""A sweep has no more settings than this."""
MOST_BEAMS: Final = 100_000
"""Nor has a scanner of it more beams."""
_SAME: Final = 1e-9
"""Values that differ by less are one."""


@dataclass(frozen=True)
class Variable:
    """A property of a scanner that can be varied.

    Attributes:
        name: Name on the command line.
        unit: Unit of its values: "deg", "m" or nothing.
        title: Title for readers.
        read: Its value of a part of a scanner, None where the part has none.
        why_not: Why a part does not have it, as the end of a sentence.
        step: Between values where a range names none; None: it has to.
        in_space: True if a plan has no such property.
    """

    name: str
    unit: str
    title: str
    read: Callable[[Part], float | None]
    why_not: str
    step: float | None = None
    in_space: bool = False

    def text(self, value: float) -> str:
        """Format a value: "aperture 60°"; nan is a curve over the range."""
        unit = {"deg": "°", "m": " m", "": ""}[self.unit]
        shown = "as a curve" if math.isnan(value) else f"{value:.6g}{unit}"
        return f"{self.title} {shown}"


def _aperture(part: Part) -> float | None:
    fans = Planar | Layers | Tilting
    return math.degrees(part.layout.aperture) if isinstance(part.layout, fans) else None


def _yaw(part: Part) -> float | None:
    layout = part.layout
    if isinstance(layout, AtPoint):
        return math.degrees(layout.mount[2])
    if isinstance(layout, Ring):
        return math.degrees(layout.start)
    return 0.0 if isinstance(layout, Mounts) and _from_one_point(layout) else None


def _beams(part: Part) -> float | None:
    return float(_count(part.layout)) if isinstance(part.layout, Planar | Ring) else None


def _height(part: Part) -> float | None:
    z = part.layout.upright()[:, 0]
    return float(z[0]) if np.ptp(z) < _SAME else None


def _pitch(part: Part) -> float | None:
    tilted = Planar | Layers | Camera
    return math.degrees(part.layout.pitch) if isinstance(part.layout, tilted) else None


def _std(part: Part) -> float | None:
    return part.sensor.std if isinstance(part.sensor.std, float) else float("nan")


def _from_one_point(layout: Mounts) -> bool:
    return bool((np.ptp(layout.mounts()[:, :2], axis=0) < _SAME).all())


VARIABLES: Final = {
    variable.name: variable
    for variable in (
        Variable(
            "aperture", "deg", "aperture", _aperture,
            "it is a camera, or its sensors are mounted individually, so there is no fan to widen",
        ),
        Variable(
            "yaw", "deg", "yaw", _yaw,
            "its sensors are mounted at several points, so there is no mount to turn it about",
        ),
        Variable(
            "beams", "", "beams", _beams,
            "its sensors are listed individually (`ambinav design beams` selects among them), or "
            "it is a 3D scanner",
            1.0,
        ),
        Variable(
            "height", "m", "height", _height,
            "its sensors are mounted at several heights, so there is no mount to raise",
            in_space=True,
        ),
        Variable(
            "pitch", "deg", "pitch", _pitch,
            "it tilts by itself, or its sensors are mounted individually, so there is no mount to "
            "tilt",
            in_space=True,
        ),
        Variable("max_range", "m", "maximum range", lambda part: part.sensor.max_range, ""),
        Variable("std", "m", "standard deviation", _std, ""),
        Variable("resolution", "m", "resolution", lambda part: part.sensor.resolution, ""),
    )
}  # fmt: skip
"""Variables by name."""


@dataclass(frozen=True)
class Variation:
    """A variable and its values.

    Attributes:
        name: A key of `VARIABLES`.
        values: Each once, at least one, in its unit.
    """

    name: str
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        """Check name and values.

        Raises:
            InputError: there is no such variable, or a value is of no use.
        """
        if self.name not in VARIABLES:
            raise InputError(
                f"vary: {self.name!r} is not a property of a scanner; "
                f"{nearest(self.name, VARIABLES)}."
            )
        distinct: list[float] = []
        for value in self.values:
            if not math.isfinite(value):
                raise InputError(f"vary {self.name}: {value} is not finite; give a number.")
            if self.name == "beams" and (value != round(value) or value < 1):
                raise InputError(
                    f"vary beams: {value:g} is not a number of beams; give 1, 2, 3 ..."
                )
            if self.name == "aperture" and not 0.0 < value <= 360.0:
                raise InputError(
                    f"vary aperture: {value:g} degrees is not an aperture; give above 0 up to 360."
                )
            if self.name == "height" and not value > 0.0:
                raise InputError(
                    f"vary height: {value:g} m is not above the floor; give metres above 0."
                )
            turn = 360.0 if self.name == "yaw" else math.inf
            if all(abs(math.remainder(value - other, turn)) > _SAME for other in distinct):
                distinct.append(value)
        if not distinct:
            raise InputError(f"vary {self.name}: there is no value; give at least one.")
        object.__setattr__(self, "values", tuple(distinct))

    @classmethod
    def parse(cls, text: str) -> Variation:
        """Read "name=first:last:step", both ends included, or "name=a,b,c".

        Angles are degrees, lengths metres; of yaws a whole turn apart the first is kept.

        Raises:
            InputError: it is neither, a range runs backwards or has a step of 0, or the values
                are of no use.
        """
        name, equals, numbers_text = (part.strip() for part in text.partition("="))
        if not equals or not numbers_text:
            raise InputError(
                f"vary: {text!r} names no values; give e.g. aperture=60:360:30 or beams=8,16,32."
            )
        if name not in VARIABLES:
            return cls(name, ())
        if ":" not in numbers_text:
            return cls(name, tuple(_number(item, text) for item in numbers_text.split(",")))
        numbers = [_number(item, text) for item in numbers_text.split(":")]
        step = VARIABLES[name].step
        if len(numbers) == 3:
            step = numbers.pop()
        if len(numbers) != 2 or step is None:
            raise InputError(
                f"vary: {text!r} is not a range; give {name}=first:last:step, e.g. "
                f"{name}={numbers[0]:g}:{numbers[1] if len(numbers) > 1 else numbers[0]:g}:10."
            )
        first, last = numbers
        if not all(map(math.isfinite, (first, last, step))):
            raise InputError(
                f"vary: {text!r} contains a number that is not finite; give finite ones."
            )
        if not step > 0.0:
            raise InputError(f"vary: {text!r} has a step of {step:g}; give one above 0.")
        if last < first:
            raise InputError(
                f"vary: {text!r} runs backwards; give {name}={last:g}:{first:g}:{step:g}."
            )
        count = math.ceil((last - first) / step - 1e-6)
        if count >= MOST_SETTINGS:
            raise InputError(_too_many(count + 1))
        return cls(name, (*(first + step * i for i in range(count)), last))


@dataclass(frozen=True)
class Setting:
    """One scanner of a sweep.

    Attributes:
        values: Value of each variation, in its unit.
        scanner: The scanner.
    """

    values: tuple[float, ...]
    scanner: RangeScanner


def settings(
    scanner: RangeScanner, variations: Sequence[Variation], part: str | None = None
) -> tuple[Setting, ...]:
    """Return the scanners of a grid of values; the last variation changes fastest.

    What is not varied stays, but that a planar scanner whose aperture is varied, and not its
    beams, keeps the angle between them.

    Args:
        scanner: The scanner to vary.
        variations: At least one, of different names.
        part: The varied part of a scanner of several parts: the name of its sensor, or its
            number from 1 on.

    Raises:
        InputError: there are too many, the scanner does not have what is varied, or has several
            parts and none is named.
    """
    names = [variation.name for variation in variations]
    if not names:
        raise InputError("vary: nothing is varied; give e.g. aperture=60:360:30.")
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"vary: {name} is varied twice; give all of its values at once.")
    count = math.prod(len(variation.values) for variation in variations)
    if count > MOST_SETTINGS:
        raise InputError(_too_many(count))
    at = part_number(scanner, part)
    for name in names:
        if VARIABLES[name].read(scanner.parts[at]) is None:
            raise InputError(
                f"vary: scanner {scanner.name!r} has no {name}: {VARIABLES[name].why_not}."
            )
    return tuple(
        Setting(values, varied(scanner, at, dict(zip(names, values, strict=True))))
        for values in itertools.product(*(variation.values for variation in variations))
    )


def part_number(scanner: RangeScanner, part: str | None) -> int:
    """Return the index of the selected part of a scanner, from 0.

    Raises:
        InputError: it has several and none of them is named, or none or several have that name.
    """
    called = [part.sensor.name or "unnamed" for part in scanner.parts]
    offer = ", ".join(f"{i} ({name})" for i, name in enumerate(called, 1))
    if part is None:
        if len(called) > 1:
            raise InputError(
                f"part: scanner {scanner.name!r} has {len(called)} parts; name the one to vary: "
                f"{offer}."
            )
        return 0
    matches = [i for i, name in enumerate(called) if name.lower() == part.lower()]
    if re.fullmatch(r"[0-9]+", part) and 1 <= int(part) <= len(called):
        matches = [int(part) - 1]
    if len(matches) != 1:
        many = "several parts" if matches else "no part"
        raise InputError(
            f"part: scanner {scanner.name!r} has {many} {part!r}; give a number: {offer}."
        )
    return matches[0]


def present_values(
    scanner: RangeScanner, variations: Iterable[Variation], part: str | None = None
) -> tuple[float, ...]:
    """Return the scanner's value of each variable; nan where that is a curve over the range."""
    selected = scanner.parts[part_number(scanner, part)]
    values = [VARIABLES[variation.name].read(selected) for variation in variations]
    return tuple(math.nan if value is None else value for value in values)


def varied(scanner: RangeScanner, at: int, values: Mapping[str, float]) -> RangeScanner:
    """Return a scanner whose part of that index has other values; see `settings`.

    Its description names the scanner and what was changed, beams that follow from another
    aperture included. Where nothing is another value it is the scanner itself.

    Raises:
        InputError: a value is out of its range.
    """
    named = ", ".join(f"{name} {value:g}" for name, value in values.items())
    part = scanner.parts[at]
    try:
        sensor = replace(
            part.sensor,
            max_range=values.get("max_range", part.sensor.max_range),
            std=values.get("std", part.sensor.std),
            resolution=values.get("resolution", part.sensor.resolution),
        )
        layout = _with_values(part.layout, values)
        count = _count(layout)
        if count > max(MOST_BEAMS, _count(part.layout)):
            raise InputError(f"that makes {count} beams; give at most {MOST_BEAMS}.")
    except InputError as error:
        raise InputError(f"vary {named}: {error}") from error
    changed = Part(sensor, layout)
    changes = _differences(part, changed, values)
    if not changes:
        return scanner
    of_part = f" of part {at + 1} ({part.sensor.name or 'unnamed'})" if scanner.parts[1:] else ""
    was = f" ({scanner.description})" if scanner.description else ""
    return replace(
        scanner,
        parts=(*scanner.parts[:at], changed, *scanner.parts[at + 1 :]),
        name=f"{scanner.name} ({named})",
        description=f"{scanner.name}{was}, but{of_part} {', '.join(changes)}",
    )


def _differences(before: Part, after: Part, values: Mapping[str, float]) -> list[str]:
    """Describe the differences, such as "aperture 60 degrees instead of 240 degrees"."""
    changes = []
    for variable in VARIABLES.values():
        old, new = (variable.read(part) for part in (before, after))
        if old is None or new is None:
            continue
        # Beams listed one by one have no yaw except the one by which they are turned.
        new = values.get(variable.name, new)
        turn = 360.0 if variable.name == "yaw" else math.inf
        if (math.isnan(old) and math.isnan(new)) or abs(math.remainder(new - old, turn)) <= _SAME:
            continue
        unit = {"deg": " degrees", "m": " m", "": ""}[variable.unit]
        was = "the curve over the range" if math.isnan(old) else f"{old:.6g}{unit}"
        changes.append(f"{variable.title} {new:.6g}{unit} instead of {was}")
    return changes


def _with_values(layout: Layout, values: Mapping[str, float]) -> Layout:
    """Return a layout with other values."""
    if "height" in values:
        layout = layout.moved(0.0, 0.0, values["height"] - float(layout.upright()[0, 0]))
    count = round(values["beams"]) if "beams" in values else None
    if "aperture" in values and isinstance(layout, Planar | Layers | Tilting):
        aperture = math.radians(values["aperture"])
        layout = (
            layout.with_aperture(aperture) if count is None else replace(layout, aperture=aperture)
        )
    if count is not None:
        if isinstance(layout, Planar):
            layout = replace(layout, beams=count)
        elif isinstance(layout, Ring):
            layout = replace(layout, count=count)
    if "yaw" in values:
        layout = _with_yaw(layout, math.radians(values["yaw"]))
    if "pitch" in values and isinstance(layout, Planar | Layers | Camera):
        layout = replace(layout, pitch=math.radians(values["pitch"]))
    return layout


def _with_yaw(layout: Layout, yaw: float) -> Layout:
    """Return a layout at another yaw, radians; of beams listed one by one turned by it."""
    if isinstance(layout, AtPoint):
        x, y, _ = layout.mount
        return replace(layout, mount=(x, y, yaw))
    if isinstance(layout, Ring):
        return replace(layout, start=yaw)
    return replace(layout, each=tuple((x, y, t + yaw) for x, y, t in layout.each))


def _count(layout: Layout) -> int:
    """Return the number of beams of a layout, without making them."""
    if isinstance(layout, Planar):
        return layout.beams
    if isinstance(layout, Ring):
        return layout.count
    if isinstance(layout, Layers):
        return layout.columns * (1 if layout.staggered else len(layout.elevation))
    if isinstance(layout, Tilting):
        return layout.beams * len(layout.pitch)
    return 0


def _number(text: str, text_of_all: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(
            f"vary: {text.strip()!r} in {text_of_all!r} is not a number; give one."
        ) from None


def _too_many(count: int) -> str:
    return f"vary: that makes {count} settings; give wider steps, for at most {MOST_SETTINGS}."
