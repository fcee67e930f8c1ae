"""A map reader: floors drawn in a text file, a character a square metre, # for a wall."""

import hashlib

import shapely

from ambinav import InputError, environment_from_shapes
from ambinav.plugin import MapReader, read_text


def read(path, *, unit=None):
    """The environment; the last line is at y = 0. `unit` "cm" makes squares of a centimetre."""
    if unit not in (None, "m", "cm"):
        raise InputError(f"{path}: unit is {unit!r}; give m or cm.")
    size = 0.01 if unit == "cm" else 1.0
    text = read_text(path)
    lines = text.splitlines()[::-1]
    squares = [
        shapely.box(size * x, size * y, size * (x + 1), size * (y + 1))
        for y, line in enumerate(lines)
        for x, letter in enumerate(line)
        if letter != "#"
    ]
    if not squares:
        raise InputError(f"{path}: every square is a wall; leave some of them free.")
    return environment_from_shapes(
        [shapely.union_all(squares)],
        name=path.stem,
        source=path,
        checksum=hashlib.sha256(text.encode()).hexdigest(),
    )


READER = MapReader(title="a drawing in letters", suffixes=("txt",), read=read)
