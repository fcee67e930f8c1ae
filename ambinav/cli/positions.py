"""Options that take two numbers or three: X Y on a floor, X Y Z in space."""

from __future__ import annotations

from typing import Any, Final

import typer.core

OPTIONS: Final = ("--start", "--goal")


class Command(typer.core.TyperCommand):
    """Command whose `OPTIONS` take two values or three; it gets them as one text, with blanks.

    The parser takes a fixed number of values for an option.
    """

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse arguments, with the values of each of `OPTIONS` joined to one."""
        return super().parse_args(ctx, joined(args))


def joined(args: list[str]) -> list[str]:
    """Return arguments with two values behind each of `OPTIONS`, or three numbers, as one text."""
    arguments: list[str] = []
    remaining = list(args)
    while remaining:
        name, equals, value = remaining.pop(0).partition("=")
        if name not in OPTIONS:
            arguments.append(f"{name}{equals}{value}")
            continue
        values = [value] if equals else []
        while remaining and len(values) < 3 and _is_value(remaining[0], len(values)):
            values.append(remaining.pop(0))
        arguments += [f"{name}={' '.join(values)}"] if values else [name]
    return arguments


def _is_value(text: str, place: int) -> bool:
    """Return whether a text is a value of an option; the third one is only if it is a number."""
    try:
        float(text)
    except ValueError:
        return place < 2 and not text.startswith("-")
    return True
