"""The card of a policy file: what the policy is, what it sees and where it was trained."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Final

import gymnasium

from ambinav.config import nearest
from ambinav.geometry.environment import Environment
from ambinav.runtime.errors import InputError
from ambinav.sensing.layout import Layout, Planar, Ring
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.policies.corrected import BASES
from ambinav_envs.policies.network import ALGORITHMS
from ambinav_envs.policies.policy import seen_in
from ambinav_envs.policies.shapes import MOST_NUMBERS, Plain, space_of
from ambinav_envs.registration import is_plain, with_task, without_own_module
from ambinav_envs.tasks import NAMESPACE

FORMAT: Final = 4
CARD: Final = "ambinav.json"
"""Member of a policy file with its card."""

_REQUIRED: Final = (
    "algorithm", "environment", "observation", "action", "steps", "code", "network",
    "weights_sha256",
)  # fmt: skip
DRAWN: Final = ("buildings", "first_building", "render_mode", "render_view")
"""Arguments of an environment that a policy does not depend on."""


@dataclass(frozen=True)
class Card:
    """Metadata that a policy file contains.

    Attributes:
        algorithm: One of `ALGORITHMS`.
        environment: Arguments of `gymnasium.make` that it was trained with, and `id`, as plain
            values; without those of `DRAWN`, but with scanner, robot and all that determine its
            observation, including defaults.
        observation: Its observation space, see `described`.
        action: Its action space, likewise.
        steps: Number of training steps.
        seed: Seed of the training.
        versions: Versions of packages, when it was saved.
        notes: Further notes from the time of saving: checksum of the buildings, a note.
        code: `ambinav.runtime.provenance.code_digest` of the code that saved it.
        network: See `network.network_of`.
        normalization: `clip` and `epsilon` of the normalisation of observations; None: there is
            none.
        base: The reactive baseline that the network corrects, one of `corrected.BASES`; None: its
            actions are those of the robot.
        weights_sha256: SHA-256 of the member that holds the weights, in hexadecimal.
        format: Format of the file.
    """

    algorithm: str
    environment: dict[str, Any]
    observation: Plain
    action: Plain
    steps: int
    seed: int | None
    versions: dict[str, str] = field(default_factory=dict)
    notes: dict[str, Any] = field(default_factory=dict)
    code: str = ""
    network: dict[str, Any] = field(default_factory=dict)
    normalization: dict[str, float] | None = None
    base: str | None = None
    weights_sha256: str = ""
    format: int = FORMAT


def parse_card(content: bytes) -> Card:
    """Read a card.

    Raises:
        InputError: it is damaged, of another format, or a key is unknown, missing or of no use.
    """
    try:
        plain = json.loads(content, parse_constant=_refused)
    except (ValueError, RecursionError) as error:
        raise InputError(f"{CARD} is not JSON ({error}); train the policy again.") from error
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise InputError(
            f"{CARD} is not of format {FORMAT}, which this version of ambinav reads; "
            "install the version that wrote it, or train the policy again."
        )
    names = [item.name for item in fields(Card)]
    for key in plain:
        if key not in names:
            raise InputError(f"{CARD} has the key {key[:80]!r}, which is unknown; save it again.")
    for key in _REQUIRED:
        if key not in plain:
            raise InputError(f"{CARD} lacks {key!r}; train the policy again.")
    card = Card(**{"seed": None, **plain})
    _check(card)
    return card


def card_text(card: Card) -> str:
    """Return a card as JSON.

    Raises:
        InputError: a value is not plain.
    """
    plain = asdict(card)
    try:
        text = json.dumps({"format": plain.pop("format"), **plain}, indent=2, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the policy's card cannot be written ({error}); give plain values."
        ) from None
    return text + "\n"


def plain_environment(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of an environment as plain values, without those of `DRAWN`.

    Those of its id, scanner and robot are written out in full, and so is what the policy sees by
    default: files may not be there later, and ids, presets and defaults may change.
    """
    arguments = of_id(environment) | dict(environment)
    seen = seen_in(arguments)
    complete = seen | arguments | {name: seen[name] for name in ("scanner", "robot")}
    if "id" in complete:
        complete["id"] = without_own_module(str(complete["id"]))
    return {name: plain_value(value) for name, value in complete.items() if name not in DRAWN}


def arguments_of(card: Card) -> dict[str, Any]:
    """Return arguments for `gymnasium.make` from a card.

    They say everything, so that an `id` stays out, but for one of others' that nobody has
    registered here, or that stands for more than arguments, and for one that nobody knows and
    without which nothing says which buildings. What a card leaves out is as by default.

    Raises:
        InputError: an argument that determines the policy's observation is invalid.
    """
    arguments = dict(card.environment)
    name = without_own_module(str(arguments.pop("id", "")))
    spec = gymnasium.registry.get(name)
    ours = name.startswith(f"{NAMESPACE}/")
    unknown = spec is None and not (ours and {"suite", "map"} & arguments.keys())
    if name and (unknown or not (ours or spec is None or is_plain(spec))):
        arguments["id"] = name
    scanner = arguments.get("scanner")
    if isinstance(scanner, Mapping):
        if not isinstance(scanner.get("yaml"), str):
            raise InputError(f"{CARD}: scanner has no text under yaml; train the policy again.")
        arguments["scanner"] = RangeScanner.from_yaml_text(scanner["yaml"], file=CARD)
    arguments = of_id(card.environment) | arguments
    seen = seen_in(arguments)
    beams = sum(_beams(part.layout) for part in seen["scanner"].parts)
    if beams > MOST_NUMBERS:
        raise InputError(
            f"{CARD}: scanner has {beams:,} beams, more than {MOST_NUMBERS:,}; train anew."
        )
    return seen | arguments


def of_id(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of the `id` of an environment; none if it is not registered here.

    A wrapped environment is not created for this: its card has all of them.
    """
    spec = gymnasium.registry.get(without_own_module(str(environment.get("id"))))
    if spec is None or not is_plain(spec):
        return {}
    replaced = ("task", "suite", "map") if environment.get("map") is not None else ("task",)
    arguments = with_task(spec.kwargs)
    return {name: value for name, value in arguments.items() if name not in (*DRAWN, *replaced)}


def plain_value(value: Any) -> Any:
    """Convert an argument of an environment to a plain value."""
    if isinstance(value, RangeScanner):
        return {"yaml": value.to_yaml()}
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Environment):
        return value.name
    if isinstance(value, Path):
        return str(value)
    return value


def _beams(layout: Layout) -> int:
    """Return how many beams a layout makes, without making them."""
    if isinstance(layout, Planar):
        return layout.beams
    return layout.count if isinstance(layout, Ring) else len(layout.mounts())


def _check(card: Card) -> None:
    """Refuse values with types that a card cannot have, and invalid spaces."""
    if card.algorithm not in ALGORITHMS:
        shown = str(card.algorithm)[:80]
        raise InputError(f"{CARD}: algorithm is {shown!r}; {nearest(shown, ALGORITHMS)}.")
    for name in ("environment", "observation", "action", "versions", "notes", "network"):
        if not isinstance(getattr(card, name), dict):
            raise InputError(f"{CARD}: {name} must be a mapping; train the policy again.")
    for name, kind in (("steps", int), ("seed", int | None), ("code", str)):
        value = getattr(card, name)
        if not isinstance(value, kind) or isinstance(value, bool):
            raise InputError(f"{CARD}: {name} is {str(value)[:80]!r}; train the policy again.")
    if card.base is not None and card.base not in BASES:
        shown = str(card.base)[:80]
        raise InputError(f"{CARD}: base is {shown!r}; {nearest(shown, BASES)}.")
    # `gymnasium.make` would import a module that an id names.
    name = card.environment.get("id", "")
    if not isinstance(name, str) or name.rpartition(":")[0] not in ("", "ambinav_envs"):
        raise InputError(
            f"{CARD}: id is {str(name)[:80]!r}, which names code; train the policy again."
        )
    limits = card.normalization
    if limits is not None and not (
        isinstance(limits, dict)
        and set(limits) == {"clip", "epsilon"}
        and all(isinstance(limit, float | int) and limit > 0 for limit in limits.values())
    ):
        raise InputError(
            f"{CARD}: normalization is {str(limits)[:80]!r}; give clip and epsilon above 0."
        )
    if "count" in card.observation or "parts" in card.action:
        raise InputError(
            f"{CARD}: observations are rows of numbers, actions one row or a count; save it again."
        )
    for part, plain in (("observation", card.observation), ("action", card.action)):
        try:
            space_of(plain)
        except InputError as error:
            raise InputError(f"{CARD}: {part}: {error}") from error


def _refused(constant: str) -> None:
    raise ValueError(f"{constant} is not a number")
