"""The panel beside the picture: state of the episode, legend, and a scale bar."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pygame

from ambinav.plotting.style import ROBOT, round_length
from ambinav_envs.rendering.camera import Camera
from ambinav_envs.rendering.floor import UNEXPLORED_COLOUR, ZONE_COLOURS, stroke
from ambinav_envs.rendering.marks import WHITE, Marks

GREY = "#5A5A5A"
# Pixels of the (large) picture.
EDGE, INDENT, ROW = 32, 88, 48
LARGE, NORMAL = 44, 34


_fonts: dict[int, pygame.font.Font] = {}


def _font(size: int) -> pygame.font.Font:
    """Return the font of a size; create it again after `pygame.quit`, which closes all fonts."""
    try:
        _fonts[size].get_height()
    except (KeyError, pygame.error):
        pygame.font.init()
        _fonts[size] = pygame.font.Font(None, size)
    return _fonts[size]


def text(
    picture: pygame.Surface, words: str, x: float, y: float, size: int = NORMAL, colour: str = ROBOT
) -> None:
    """Write a line from x on, its middle at y; text that does not fit ends with three dots."""
    font, room = _font(size), picture.get_width() - x - 8
    shown = words
    while font.size(shown)[0] > room and len(shown) > 4:
        shown = shown[: -2 if shown == words else -4] + "..."
    line = font.render(shown, True, colour)
    picture.blit(line, (x, y - 0.5 * line.get_height()))


def panel(
    size: tuple[int, int], title: str, figures: dict[str, str], scale: float, shown: set[str]
) -> pygame.Surface:
    """Draw the panel.

    Args:
        size: Width and height, pixels.
        title: Title of the building.
        figures: Text by name.
        scale: Scale of the picture beside it, pixels per metre.
        shown: What else is in the picture: "people", "boxes", "ellipse", "unexplored".
    """
    picture = pygame.Surface(size)
    picture.fill(WHITE)
    fits = _font(LARGE).size(title)[0] < size[0] - EDGE - 8
    text(picture, title, EDGE, 48, LARGE if fits else NORMAL)
    y = 108.0
    for name, value in figures.items():
        text(picture, name, EDGE, y, colour=GREY)
        text(picture, value, 0.5 * size[0], y)
        y += 40.0
    y += 28.0
    for name, draw in _entries(shown):
        draw(Marks(picture, Camera(0.0, 0.0, 1.0, size)), y)
        text(picture, name, INDENT + 12, y)
        y += ROW
    _scale_bar(picture, scale)
    return picture


def _entries(shown: set[str]) -> list[tuple[str, Callable[[Marks, float], None]]]:
    """Return name and drawing function of each legend entry, at one pixel a metre."""

    def at(marks: Marks, y: float, x: float = 0.5 * (EDGE + INDENT)) -> tuple[float, float]:
        width, height = marks.camera.size
        return x - 0.5 * width, 0.5 * height - y

    def line(marks: Marks, y: float) -> list[tuple[float, float]]:
        return [at(marks, y, EDGE - 4), at(marks, y, INDENT - 4)]

    def swatch(colour: tuple[int, ...]) -> Callable[[Marks, float], None]:
        def draw(marks: Marks, y: float) -> None:
            area = pygame.Rect(EDGE, int(y) - 14, INDENT - EDGE - 8, 28)
            pygame.draw.rect(marks.picture, colour, area)
            pygame.draw.rect(marks.picture, GREY, area, 2)

        return draw

    zero = np.zeros(1)
    entries: list[tuple[str, Callable[[Marks, float], None]]] = [
        ("robot", lambda m, y: m.robot((*at(m, y), 0.0), 14)),
        ("its estimate", lambda m, y: m.belief((*at(m, y), 0.0), None, 13)),
    ]
    if "ellipse" in shown:
        wide = np.diag([13.0**2, 7.0**2, 1.0])
        entries.append(("2 sigma of it", lambda m, y: m.ellipse((*at(m, y), 0.0), wide)))
    entries += [
        ("path", lambda m, y: m.trail(np.array(line(m, y)))),
        ("estimated path", lambda m, y: m.estimated_trail(np.array(line(m, y)))),
        ("goal", lambda m, y: m.goal(at(m, y), 17)),
        (
            "beam, echo",
            lambda m, y: m.scan(np.array(line(m, y)[:1]), np.array(line(m, y)[1:]), zero == 0.0),
        ),
    ]
    if "boxes" in shown:
        half = [18.0, 0.0, 0.0, 13.0]
        entries.append(("unmapped box", lambda m, y: m.box(np.array([*at(m, y), *half]))))
    if "people" in shown:
        entries.append(("person", lambda m, y: m.person(np.array([*at(m, y), 0.0]), 15)))
    entries += [(name, swatch(colour)) for name, colour in ZONE_COLOURS.items()]
    if "unexplored" in shown:
        entries.append(("unexplored", swatch(UNEXPLORED_COLOUR)))
    return entries


def _scale_bar(picture: pygame.Surface, scale: float) -> None:
    """Draw a bar of a round length at the lower end of the panel."""
    width, height = picture.get_size()
    length = round_length(4.0 * (width - 2.0 * EDGE - 110.0) / scale)
    y, right = height - 40.0, EDGE + length * scale
    stroke(picture, ROBOT, [EDGE, y], [right, y], 4)
    for x in (float(EDGE), right):
        stroke(picture, ROBOT, [x, y - 10.0], [x, y + 10.0], 4)
    text(picture, f"{length:g} m" if length >= 1.0 else f"{100 * length:g} cm", right + 18.0, y)
