"""The routes of a scenario file: their kinds, and the keys that each kind accepts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import Field, model_validator

from ambinav.config import ConfigModel, check_keys, nearest
from ambinav.runtime.errors import InputError

KINDS = (
    *("shortest", "clearance", "ambiguity", "belief", "belief-roadmap", "reference"),
    *("planner", "file", "policy"),
)
"""Kinds of routes."""

GIVEN = ("file", "policy")
"""Kinds of routes that are not planned here, but come from elsewhere."""

ALLOWED_KEYS: Mapping[str, tuple[str, ...]] = {
    "shortest": ("planner", "iterations", "seed"),
    "clearance": ("planner", "iterations", "seed", "clearance_weight", "comfort"),
    "ambiguity": ("planner", "iterations", "seed", "weight"),
    "belief": ("weight",),
    "belief-roadmap": ("iterations", "seed", "weight"),
    "reference": ("weight",),
    "planner": ("planner", "iterations", "seed", "weight"),
    "file": ("file", "pair"),
    "policy": ("policy", "pair"),
}
"""Which keys mean something to a kind, besides `kind` and `name`."""

NEEDED: Mapping[str, str] = {"planner": "planner", "file": "file", "policy": "policy"}
"""Keys that a kind cannot do without."""


class RoutePart(ConfigModel):
    """A route to compare; None means the value of `planning` or of the planner."""

    kind: Literal[*KINDS]  # type: ignore[valid-type]
    name: str = Field(min_length=1)
    weight: float = Field(default=5.0, ge=0.0)
    clearance_weight: float = Field(default=5.0, gt=0.0)
    comfort: float = Field(default=1.0, gt=0.0)
    planner: str | None = None
    iterations: int | None = Field(default=None, ge=1)
    seed: int | None = Field(default=None, ge=0, lt=2**32 - 1)
    file: str | None = None
    pair: str | None = None
    policy: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _expand_kind(cls, plain: Any) -> Any:
        """Expand a plain kind to a full route; refuse keys that the kind does not accept."""
        if isinstance(plain, str):
            plain = {"kind": plain}
        if not isinstance(plain, Mapping):
            raise InputError("give the kind of a route, or a mapping with the key kind")
        check_keys(plain, cls.model_fields)
        kind = str(plain.get("kind"))
        if "kind" not in plain or kind not in KINDS:
            raise InputError(f"kind is {plain.get('kind')!r}; {nearest(kind, KINDS)}")
        for key in plain:
            if key not in ("kind", "name", *ALLOWED_KEYS[kind]):
                raise InputError(f"{key} is not a key of a route of the kind {kind!r}; remove it")
        if kind in NEEDED and NEEDED[kind] not in plain:
            raise InputError(f"a route of the kind {kind!r} needs the key {NEEDED[kind]!r}; add it")
        return {"name": _default_name(kind, plain), **plain}


def _default_name(kind: str, plain: Mapping[str, Any]) -> str:
    if kind == "planner":
        return f"{plain['planner']} {plain.get('weight', 5.0)}"
    if kind in ("file", "policy"):
        return str(plain[kind])
    if kind in ("shortest", "clearance"):
        return kind
    return f"{kind} {plain['weight']}" if "weight" in plain else kind
