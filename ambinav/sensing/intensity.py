"""Intensity of an echo, and what it tells about the surface: wall or reflector.

Many laser scanners report a strength beside each range (RSSI, remission). Its unit is the maker's
own; what counts here is how far apart walls and reflectors are in it. A retroreflector sends light
back where it came from and reads near the top of the scale, whereas walls scatter it: SICK's
operating instructions put white plaster at 100 % remission and reflectors above that, and a
reflector at the largest value that is not dazzled (LMS4000 8023198, page 19; LRS4000 8026338,
section 3.4.8). They warn as well that near the device white paper may read like a reflector, for
which there is `min_range`.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import ArrayLike

from ambinav.config import NonNegative, Positive, check_fields, check_generator
from ambinav.runtime.array_types import Bools, Floats, Floats32
from ambinav.runtime.errors import InputError


@dataclass(frozen=True)
class Intensity:
    """Intensity channel of a laser: readings of walls and reflectors, in any one unit.

    Readings are normal about the mean of the surface that the beam meets, and independent of range
    and incidence: use values after the corrections of your scanner or driver, and a deviation that
    includes the remaining effects.

    Attributes:
        wall: Mean reading of walls, people and all else that is not a reflector.
        reflector: Mean reading of reflectors, above that of walls.
        std: Standard deviation of one reading, walls of all colours included.
        min_range: Smallest range at which a reading distinguishes them, metres.

    Raises:
        InputError: a value is out of its range.
    """

    wall: NonNegative
    reflector: Positive
    std: Positive
    min_range: NonNegative = 0.0

    def __post_init__(self) -> None:
        """Check every value and convert it to its type."""
        check_fields(self)
        if self.reflector <= self.wall:
            raise InputError(
                f"reflector is {self.reflector:g}; give more than wall ({self.wall:g}), in the "
                "unit that the scanner reads."
            )

    @property
    def distinguished(self) -> float:
        """Probability that a threshold midway between the means classifies a reading correctly."""
        return 0.5 * math.erfc((self.wall - self.reflector) / (math.sqrt(8.0) * self.std))

    def read(self, reflects: ArrayLike, rng: np.random.Generator) -> Floats32:
        """Simulate one reading of each surface, float32, of the shape of `reflects` (bool).

        Raises:
            InputError: `rng` is no Generator.
        """
        check_generator(rng)
        bright = np.asarray(reflects, dtype=np.bool_)
        return self.reading(bright, rng.standard_normal(bright.shape))

    def reading(self, reflects: Bools, noise: Floats) -> Floats32:
        """Return intensities as `read` does, from given normal samples of the same shape."""
        mean = np.where(reflects, self.reflector, self.wall)
        # No echo is weaker than none.
        return np.asarray(np.maximum(mean + self.std * noise, 0.0), dtype=np.float32)

    def to_plain(self) -> dict[str, float]:
        """Return the YAML form."""
        return asdict(self)
