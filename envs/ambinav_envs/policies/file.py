"""Policy files: what Stable-Baselines3 saves, and beside it what the policy is and sees."""

from __future__ import annotations

import io
import json
import platform
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Any, Final

from ambinav.config import nearest
from ambinav.errors import InputError
from ambinav.files import replacing
from ambinav.geometry.environment import Environment
from ambinav.provenance import code_digest, library_version
from ambinav.sensing.scanner import RangeScanner
from ambinav_envs.policies.normalization import Normalization
from ambinav_envs.policies.policy import seen_in
from ambinav_envs.policies.shapes import Plain, described

FORMAT: Final = 2
CARD: Final = "ambinav.json"
"""Member of a policy file that says what it is."""
MOMENTS: Final = "normalization.npz"
"""Member that holds the normalisation, if there is one."""
ALGORITHMS: Final = ("PPO", "SAC", "RecurrentPPO")

DRAWN: Final = ("buildings", "first_building", "render_mode", "render_view")
"""Arguments of an environment that a policy does not depend on."""
UNREADABLE: Final = (
    OSError, EOFError, ValueError, KeyError, RuntimeError, zlib.error, zipfile.BadZipFile,
)  # fmt: skip
"""What reading a damaged zip file may raise; RuntimeError: a bit says that it is encrypted, or
packed in an unknown way."""
# What a model remembers of its training and needs for nothing but that.
_LEFT_OUT = (
    "_last_obs", "_last_original_obs", "_last_episode_starts", "_last_lstm_states",
    "ep_info_buffer", "ep_success_buffer", "start_time", "tensorboard_log",
)  # fmt: skip
_PACKAGES = ("ambinav", "stable-baselines3", "torch", "gymnasium", "numpy")


@dataclass(frozen=True)
class Card:
    """What a policy file says of itself.

    Attributes:
        algorithm: One of `ALGORITHMS`.
        environment: Arguments of `gymnasium.make` that it was trained with, and `id`, as plain
            values; none of `DRAWN`, but scanner, robot and all that say what it sees, those by
            default among them.
        observation: What it sees, see `described`.
        action: What it gives, likewise.
        steps: How many steps it was trained for.
        seed: Of the training.
        versions: Of packages, when it was saved.
        notes: What else was noted when it was saved: checksum of the buildings, a note.
        code: `ambinav.provenance.code_digest` of what saved it; empty in files of earlier versions.
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


def save_policy(
    model: Any,
    path: str | Path,
    *,
    environment: Mapping[str, Any],
    normalization: Any = None,
    notes: Mapping[str, Any] | None = None,
    slim: bool = False,
) -> None:
    """Write a policy file, whole or not at all.

    Args:
        model: PPO or SAC of Stable-Baselines3, or RecurrentPPO of sb3-contrib.
        path: The file, NAME.zip.
        environment: Arguments that the environment was made with, and its `id`.
        normalization: `VecNormalize` or `Normalization` of the observations, if there was one.
        notes: Further plain values for the card.
        slim: Leave out what the optimizer remembers, most of a file. `PPO.load` reads it all the
            same; training on begins with a fresh optimizer.

    Raises:
        InputError: the algorithm is another, a value is not plain, or nothing can be written.
    """
    name = type(model).__name__
    if name not in ALGORITHMS:
        raise InputError(f"the model is a {name}; {nearest(name, ALGORITHMS)}.")
    if normalization is not None and not isinstance(normalization, Normalization):
        normalization = Normalization.of(normalization)
    card = Card(
        name,
        plain_environment(environment),
        described(model.observation_space),
        described(model.action_space),
        int(model.num_timesteps),
        None if model.seed is None else int(model.seed),
        _versions(name),
        dict(notes or {}),
        code_digest(),
    )
    try:
        text = _card_text(card)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"the policy's card cannot be written ({error}); give plain values."
        ) from None
    saved = io.BytesIO()
    model.save(saved, exclude=_LEFT_OUT)
    with (
        zipfile.ZipFile(saved) as source,
        replacing(Path(path)) as fresh,
        zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as out,
    ):
        for member in source.namelist():
            content = source.read(member)
            # It names the machine; versions are on the card.
            if member == "system_info.txt":
                continue
            if slim and member.endswith("optimizer.pth"):
                content = _without_state(content)
            out.writestr(member, content)
        out.writestr(CARD, text)
        if normalization is not None:
            out.writestr(MOMENTS, normalization.to_bytes())


def read_card(path: str | Path) -> Card:
    """What a policy file says of itself; this needs no torch.

    Raises:
        InputError: there is no such file, or it is none that `save_policy` of this version wrote.
    """
    card, _ = read_members(path)
    return card


def read_members(path: str | Path) -> tuple[Card, Normalization | None]:
    """The two members of a policy file that are ours.

    Raises:
        InputError: see `read_card`.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; give a policy's .zip file.")
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            content = archive.read(CARD) if CARD in names else None
            moments = archive.read(MOMENTS) if MOMENTS in names else None
            broken = archive.testzip()
    except UNREADABLE as error:
        raise InputError(
            f"{path}: this is no policy file ({error}); copy or train it again."
        ) from error
    if broken is not None:
        raise InputError(f"{path}: the member {broken} is damaged; copy or train it again.")
    if content is None:
        raise InputError(
            f"{path}: the member {CARD} is missing, so nobody knows what the policy sees; save it "
            "with ambinav_envs.policies.save_policy."
        )
    try:
        return _card(content), None if moments is None else Normalization.from_bytes(moments)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _card(content: bytes) -> Card:
    try:
        plain = json.loads(content)
    except ValueError as error:
        raise InputError(f"{CARD} is no JSON ({error}); train the policy again.") from error
    if not isinstance(plain, dict) or plain.pop("format", None) != FORMAT:
        raise InputError(
            f"{CARD} is not of format {FORMAT}, which this version of ambinav reads; install the "
            "version that wrote it, or train the policy again."
        )
    known = [item.name for item in fields(Card)]
    for key in ("algorithm", "environment", "observation", "action", "steps"):
        if key not in plain:
            raise InputError(f"{CARD} lacks {key!r}; train the policy again.")
    card = Card(**{key: value for key, value in plain.items() if key in known})
    if card.algorithm not in ALGORITHMS:
        raise InputError(
            f"{CARD}: algorithm is {card.algorithm!r}; {nearest(str(card.algorithm), ALGORITHMS)}."
        )
    shapes = (card.environment, card.observation, card.action)
    if not all(isinstance(part, dict) for part in shapes):
        raise InputError(f"{CARD}: environment, observation and action must be mappings.")
    return card


def complete_card(path: str | Path, notes: Mapping[str, Any] | None = None) -> bool:
    """Write out in a policy file's card what files of earlier versions left to the defaults.

    All other members stay as they are, byte for byte, with their times; doing it twice changes
    nothing. The defaults must be those of when the policy was trained, which whoever calls this
    has made sure of.

    Args:
        path: The file.
        notes: Further plain values for the card's `notes`.

    Returns:
        Whether something was to be done.

    Raises:
        InputError: see `read_card`; or nothing can be written.
    """
    path = Path(path)
    card = read_card(path)
    environment = {"id": card.environment["id"]} if "id" in card.environment else {}
    environment = plain_environment(arguments_of(card)) | environment
    whole = replace(card, environment=environment, notes={**card.notes, **(notes or {})})
    if whole == card:
        return False
    with (
        zipfile.ZipFile(path) as source,
        replacing(path) as fresh,
        zipfile.ZipFile(fresh, "w", zipfile.ZIP_DEFLATED) as out,
    ):
        for member in source.infolist():
            content = source.read(member)
            if member.filename == CARD:
                content = _card_text(whole).encode()
            out.writestr(member, content)
    return True


def _card_text(card: Card) -> str:
    return json.dumps({"format": FORMAT, **asdict(card)}, indent=2, allow_nan=False) + "\n"


def plain_environment(environment: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of an environment as plain values, without those of `DRAWN`.

    Scanner and robot are written out in full, and so is what the policy sees by default: files may
    not be there later, and presets and defaults may change.
    """
    seen = seen_in(environment)
    whole = seen | dict(environment) | {name: seen[name] for name in ("scanner", "robot")}
    return {name: plain_value(value) for name, value in whole.items() if name not in DRAWN}


def arguments_of(card: Card) -> dict[str, Any]:
    """Arguments for `gymnasium.make`, without `id`, from a card.

    Older files leave out what their policy saw and drove by default; it is filled in.

    Raises:
        InputError: an argument that says what the policy sees is of no use.
    """
    arguments = {name: value for name, value in card.environment.items() if name != "id"}
    scanner = arguments.get("scanner")
    if isinstance(scanner, Mapping):
        if not isinstance(scanner.get("yaml"), str):
            raise InputError(f"{CARD}: scanner has no text under yaml; train the policy again.")
        arguments["scanner"] = RangeScanner.from_yaml_text(scanner["yaml"], file=CARD)
    return seen_in(arguments) | arguments


def plain_value(value: Any) -> Any:
    """An argument of an environment as a plain value."""
    if isinstance(value, RangeScanner):
        return {"yaml": value.to_yaml()}
    if is_dataclass(value) and not isinstance(value, type):
        return asdict(value)
    if isinstance(value, Environment):
        return value.name
    if isinstance(value, Path):
        return str(value)
    return value


def _without_state(content: bytes) -> bytes:
    """An optimizer's saved state without its moments: as large as nothing, and it still loads."""
    import torch

    state = torch.load(io.BytesIO(content), weights_only=True, map_location="cpu")
    out = io.BytesIO()
    torch.save({**state, "state": {}}, out)
    return out.getvalue()


def _versions(algorithm: str) -> dict[str, str]:
    packages = (*_PACKAGES, *(("sb3-contrib",) if algorithm == "RecurrentPPO" else ()))
    found = {name: library_version(name) for name in packages}
    known = {name: version for name, version in found.items() if version is not None}
    return {"python": platform.python_version(), **known}
