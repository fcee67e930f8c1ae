"""Roles of the layers of a CAD drawing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Final

from ambinav.runtime.errors import InputError

ROLES: Final = ("walls", "columns", "glass", "doors", "furniture", "floor", "ignore")
"""Possible roles of a layer."""

# The first that is found in a layer's name, whatever its case: English, German, French, Spanish,
# Italian, Portuguese, and the abbreviations of the AIA's layer guidelines (A-WALL, A-GLAZ ...).
_NAMES: Final = {
    "ignore": r"(?<!kon)text|dim|annot|hatch|(?<![a-z])anno|ma(ss|ß)(?!iv)|bema|schraff|cota|"
    r"(?<!p)roof|dach(?!geschoss)|ceil|decke",
    "doors": r"door|t(ü|ue)r(en)?(?![a-z])|porte|puerta|porta(?![a-z])",
    "glass": r"glas|glaz|crystal|cristal|vitr|vetro|vidrio|window|fenst|fen[eê]tre|ventana|janela",
    "columns": r"(?<![a-z])col(umn)?s?(?![a-z])|pillar|pilar|st(ü|ue)tze|s(ä|ae)ule|poteau|pilast",
    "walls": r"wall|wand|w(ä|ae)nde|mauer|(?<![a-z])murs?(?![a-z])|muro|pared|parete|tabique",
    "furniture": r"furn|m(ö|oe)bel|mobili|meuble|equip|sanit|fixt",
    "floor": r"floor|boden|(?<![a-z])sol(?![a-z])|piso|suelo|paviment",
}


def role_by_name(name: str) -> str | None:
    """Return the role, one of `ROLES`, that a layer's name suggests; None: no role."""
    for role, pattern in _NAMES.items():
        if re.search(pattern, name, re.IGNORECASE):
            return role
    return None


def roles_of(
    where: str, drawn: Iterable[str], layers: Mapping[str, str] | None
) -> tuple[dict[str, str], list[str]]:
    """Return the role of each layer, and the layers that are left out.

    Args:
        where: The file.
        drawn: Names of the layers on which something is drawn.
        layers: Roles by name that the user gives, whatever the names' case; they go before the
            names' own meaning.

    Raises:
        InputError: a role or a layer that is given is none, or no layer holds walls.
    """
    names = sorted(set(drawn))
    by_casefold = {name.casefold(): name for name in names}
    roles = {name: role_by_name(name) or "" for name in names}
    if len(names) == 1 and not roles[names[0]]:
        roles[names[0]] = "walls"
    for name, role in (layers or {}).items():
        if role not in ROLES:
            raise InputError(f"{where}: layers: {name} is {role!r}; it must be {', '.join(ROLES)}.")
        if name.casefold() not in by_casefold:
            raise InputError(
                f"{where}: layers: nothing is drawn on a layer {name!r}; it has {', '.join(names)}."
            )
        roles[by_casefold[name.casefold()]] = role
    if not {"walls", "columns"} & set(roles.values()):
        raise InputError(
            f"{where}: none of its layers ({', '.join(names)}) holds walls by its name; say which "
            "does with --cad-layer NAME=walls (layers={...} in Python)."
        )
    out = [name for name in names if roles[name] in ("", "ignore")]
    return {name: role for name, role in roles.items() if name not in out}, out
