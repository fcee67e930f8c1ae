"""Levels of a drawn plan: the property `level` of its features, and the choice of one."""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Sequence

from ambinav.runtime.errors import InputError


def levels_of(label: str, value: object) -> tuple[str, ...]:
    """Return the levels in a feature's property `level`; none for a feature without it.

    A number or a text; several, as OpenStreetMap writes them, in one text with semicolons
    ("0;1") or in a list.

    Raises:
        InputError: it is something else.
    """
    if value is None or value == "":
        return ()
    if isinstance(value, list):
        return tuple(dict.fromkeys(name for part in value for name in levels_of(label, part)))
    if isinstance(value, str):
        return tuple(dict.fromkeys(p.strip() for p in value.split(";") if p.strip()))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return (f"{value:.15g}",)
    raise InputError(
        f"{label}: level is {reprlib.repr(value)}; it must be the name or number of a floor."
    )


def in_order(names: Iterable[str]) -> tuple[str, ...]:
    """Sort distinct levels: numerically if all are numbers, else in the file's order."""
    distinct = tuple(dict.fromkeys(names))
    try:
        return tuple(sorted(distinct, key=float))
    except ValueError:
        return distinct


def chosen_level(
    where: str, names: Sequence[str], level: str | int | None, listed: Sequence[str] | None = None
) -> str | None:
    """Choose a level of a file.

    Args:
        where: The file.
        names: Its levels, in order.
        level: A name, whatever its case, or a position from 0 on among `names`: a name that is a
            number goes before a position. None: the only one.
        listed: What messages say of each instead of its name.

    Returns:
        One of `names`, or None if there are none and none is asked for.

    Raises:
        InputError: there is no such level, or there are several and none is chosen.
    """
    level_names = _listed(listed or names)
    if level is None:
        if len(names) > 1:
            raise InputError(
                f"{where}: it holds {len(names)} levels ({level_names}), which are floors above "
                "each other; choose one with --level NAME."
            )
        return names[0] if names else None
    requested = str(level).strip()
    if not names:
        raise InputError(
            f"{where}: no feature has the property level, but level {requested!r} is asked for; "
            "leave it out."
        )
    folded = [name for name in names if name.casefold() == requested.casefold()]
    if requested in names:
        return requested
    if len(folded) == 1:
        return folded[0]
    if requested.isdecimal() and int(requested) < len(names):
        return names[int(requested)]
    near = difflib.get_close_matches(requested, names, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}? It has {level_names}" if near else f"choose from {level_names}"
    raise InputError(
        f"{where}: there is no level {requested!r}; {hint.replace('? It has', ', of')}."
    )


def _listed(names: Sequence[str], most: int = 20) -> str:
    """List the names, only the first ones if there are many."""
    shown = ", ".join(names[:most])
    return shown if len(names) <= most else f"{shown} and {len(names) - most} more"
