"""Pictures of episodes, drawn with pygame, which is imported on first use."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Final

from gymnasium.error import DependencyNotInstalled

from ambinav.config import nearest
from ambinav.runtime.errors import InputError
from ambinav_envs.rendering.camera import as_view
from ambinav_envs.simulation.simulation import Simulation

if TYPE_CHECKING:
    from ambinav_envs.rendering.renderer import Renderer

MODES: Final = ("human", "rgb_array")


def renderer_for(simulation: Simulation, mode: str | None, view: str) -> Renderer | None:
    """Create the renderer of a simulation; None if nothing is drawn.

    Args:
        simulation: The simulation.
        mode: One of `MODES`; None: nothing is to be drawn.
        view: One of `camera.VIEWS`.

    Raises:
        InputError: there is no such mode or view.
        DependencyNotInstalled: pygame is missing.
    """
    view = as_view(view)
    if mode is None:
        return None
    if mode not in MODES:
        raise InputError(f"render_mode is {mode!r}; {nearest(str(mode), MODES)}, or leave it out.")
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        from ambinav_envs.rendering.renderer import Renderer
    except ModuleNotFoundError as error:
        if error.name != "pygame":
            raise
        raise DependencyNotInstalled(
            'pygame is missing; run `pip install "ambinav[envs]"`, or leave out render_mode.'
        ) from error
    return Renderer(simulation, view)


def metadata_for(dt: float) -> dict[str, Any]:
    """Return the render modes, and the frame rate for time steps of `dt` seconds."""
    return {"render_modes": list(MODES), "render_fps": max(1, round(1.0 / dt))}
