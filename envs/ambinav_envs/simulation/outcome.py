"""Result of a step of the environments."""

from __future__ import annotations

from typing import NamedTuple

from ambinav.runtime.array_types import Floats, Floats32
from ambinav_envs.plugged import Plugged
from ambinav_envs.simulation.layout import View


class Outcome(NamedTuple):
    """Result of a step or reset for all robots, in arrays that are not shared.

    Attributes:
        view: The observation.
        figures: See `layout.COLUMNS`, shape (N, COLUMNS).
        plugged: Additions of plug-ins.
    """

    view: View
    figures: Floats
    plugged: Plugged

    @property
    def observation(self) -> dict[str, Floats32]:
        """Enabled parts of the observation by name, shape (N, size)."""
        parts = {name: part for name, part in self.view._asdict().items() if part.shape[1] > 0}
        return parts | self.plugged.parts
