"""Policy files: a card, spaces and weights, all of them plain data."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.config import nearest
from ambinav.runtime.errors import InputError
from ambinav.runtime.files import replacing
from ambinav.runtime.provenance import code_digest, library_versions
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.policies.archive import MEBIBYTE, read_archive, write_archive
from ambinav_envs.policies.card import CARD, Card, card_text, of_id, parse_card, plain_environment
from ambinav_envs.policies.corrected import CorrectedPolicy
from ambinav_envs.policies.network import ALGORITHMS, build_policy, network_of, required, weights_of
from ambinav_envs.policies.normalization import Normalization, sizes_of
from ambinav_envs.policies.policy import BUILDINGS, ModelPolicy
from ambinav_envs.policies.shapes import described, space_of
from ambinav_envs.registration import spec_of, without_own_module
from ambinav_envs.spaces import action_space, observation_space
from ambinav_envs.tasks import NAMESPACE

WEIGHTS: Final = "weights.safetensors"
"""Member of a policy file that holds all tensors: policy.NAME, and those of the normalisation."""
SIZES: Final = {CARD: MEBIBYTE, WEIGHTS: 68 * MEBIBYTE}
"""Members of a policy file, and the most bytes that each may have."""
STABLE_BASELINES: Final = (
    "data", "policy.pth", "pytorch_variables.pth", "policy.optimizer.pth", "actor.optimizer.pth",
    "critic.optimizer.pth", "ent_coef_optimizer.pth", "_stable_baselines3_version",
    "system_info.txt",
)  # fmt: skip
"""Members of what `model.save` of Stable-Baselines3 writes; they are not looked into here."""

_POLICY, _NORMALIZATION = "policy.", "normalization."
_VERSIONED = ("ambinav", "stable-baselines3", "torch", "gymnasium", "numpy", "safetensors")


@dataclass(frozen=True, eq=False)
class PolicyFile:
    """The content of a policy file.

    Attributes:
        card: The card, in the present format.
        weights: Weights of the network, by name.
        normalization: Normalisation of what the policy sees, if there is one.
    """

    card: Card
    weights: dict[str, NDArray[Any]]
    normalization: Normalization | None = None

    def build(self) -> Any:
        """Build the policy, see `network.build_policy`.

        Raises:
            InputError: the same.
        """
        card = self.card
        observation, action = space_of(card.observation), space_of(card.action)
        return build_policy(card.algorithm, card.network, observation, action, self.weights)


def save_policy(
    model: Any,
    path: str | Path,
    *,
    environment: Mapping[str, Any],
    normalization: Any = None,
    notes: Mapping[str, Any] | None = None,
    base: str | None = None,
) -> None:
    """Write a policy file atomically.

    Args:
        model: PPO or SAC of Stable-Baselines3, or RecurrentPPO of sb3-contrib.
        path: The file, NAME.zip.
        environment: Arguments that the environment was made with, and its `id`.
        normalization: `VecNormalize` or `Normalization` of the observations, if there was one.
        notes: Further plain values for the card.
        base: The reactive baseline that the model corrects, see `Card`.

    Raises:
        InputError: the algorithm or a part of the network is another than files can hold, an
            argument of the environment is unknown or has a value of no use, the model does not fit
            that environment, a value is not plain, nobody has registered an `id` of ours, or
            nothing can be written.
    """
    task = without_own_module(str(environment.get("id", "")))
    ours = task.startswith(f"{NAMESPACE}/")
    if ours:
        spec_of(task)  # else nobody could say in which buildings the policy was trained
    name = type(model).__name__
    if name not in ALGORITHMS:
        raise InputError(f"the model is a {name}; {nearest(name, ALGORITHMS)}.")
    if normalization is not None and not isinstance(normalization, Normalization):
        normalization = Normalization.of(normalization)
    for space in (model.observation_space, model.action_space):
        restored = space_of(described(space))
        # Also its order and types, which gymnasium does not compare.
        if str(restored) != str(space) or restored != space:
            raise InputError(f"the space {space} is none that a policy file can hold; use float32.")
    limits = None
    if normalization is not None:
        limits = {"clip": normalization.clip, "epsilon": normalization.epsilon}
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
        network_of(model),
        limits,
        base,
    )
    if ours or not task:
        _check_fit(ModelPolicy(model, name=Path(path).stem), environment, base)
    write_policy_file(PolicyFile(card, dict(weights_of(model.policy)), normalization), path)


def _check_fit(model: ModelPolicy, environment: Mapping[str, Any], base: str | None) -> None:
    """Check that a model could drive in an environment of ours that is made with these arguments.

    Raises:
        InputError: it could not, or an argument is unknown or has a value of no use.
    """
    names = [item.name for item in fields(NavigationParameters)]
    allowed = (*names, *BUILDINGS, "render_mode")
    for key in environment:
        if key not in allowed:
            raise InputError(f"environment has the key {key!r}; {nearest(str(key), allowed)}.")
    arguments = of_id(environment) | dict(environment)
    parameters = NavigationParameters.of(
        {name: arguments[name] for name in names if name in arguments}
    )
    policy = model if base is None else CorrectedPolicy(model, base)
    policy.prepare(observation_space(parameters), action_space(parameters))


def write_policy_file(policy: PolicyFile, path: str | Path) -> None:
    """Write a policy file atomically; the same content gives the same bytes.

    Raises:
        InputError: a value of the card is not plain, or nothing can be written.
    """
    tensors = {_POLICY + name: values for name, values in policy.weights.items()}
    if policy.normalization is not None:
        moments = policy.normalization.tensors()
        tensors |= {_NORMALIZATION + name: values for name, values in moments.items()}
    # It takes the bytes as they lie.
    tensors = {name: np.ascontiguousarray(values) for name, values in tensors.items()}
    content = required("safetensors.numpy").save(tensors)
    text = card_text(replace(policy.card, weights_sha256=hashlib.sha256(content).hexdigest()))
    with replacing(Path(path)) as fresh:
        write_archive(fresh, {CARD: text.encode(), WEIGHTS: content})


def read_card(path: str | Path) -> Card:
    """Read the card of a policy file; this needs no torch.

    Raises:
        InputError: there is no such file, it is damaged, or none that `save_policy` wrote.
    """
    card, _ = _read(Path(path))
    return card


def read_policy_file(path: str | Path) -> PolicyFile:
    """Read all of a policy file; nothing is unpickled.

    Raises:
        InputError: see `read_card`; or the weights or the normalisation are of no use.
    """
    path = Path(path)
    card, members = _read(path)
    try:
        return _parsed(card, members)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def is_plain_model(path: Path) -> bool:
    """Return whether a file has no card, like the output of Stable-Baselines3's `model.save`.

    Raises:
        InputError: see `archive.read_archive`.
    """
    return CARD not in read_archive(path, SIZES, STABLE_BASELINES)


def _read(path: Path) -> tuple[Card, dict[str, bytes]]:
    if is_plain_model(path):
        raise InputError(
            f"{path}: the member {CARD} is missing, so nobody knows what the policy sees; save it "
            "with ambinav_envs.policies.save_policy."
        )
    members = read_archive(path, SIZES)
    try:
        return parse_card(members.pop(CARD)), members
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _parsed(card: Card, members: Mapping[str, bytes]) -> PolicyFile:
    if WEIGHTS not in members:
        raise InputError(f"the member {WEIGHTS} is missing; copy or train it again.")
    if hashlib.sha256(members[WEIGHTS]).hexdigest() != card.weights_sha256:
        raise InputError(
            f"{WEIGHTS} was changed since the policy was saved: its SHA-256 is not the "
            f"weights_sha256 in {CARD}; copy or train it again."
        )
    reader = required("safetensors.numpy")
    try:
        tensors: dict[str, NDArray[Any]] = reader.load(members[WEIGHTS])
    except (required("safetensors").SafetensorError, KeyError, ValueError, TypeError) as error:
        raise InputError(f"{WEIGHTS} cannot be read ({error}); copy or train it again.") from error
    weights: dict[str, NDArray[Any]] = {}
    moments: dict[str, NDArray[Any]] = {}
    for name, values in tensors.items():
        for prefix, group in ((_POLICY, weights), (_NORMALIZATION, moments)):
            if name.startswith(prefix):
                group[name.removeprefix(prefix)] = values
                break
        else:
            raise InputError(f"weights: {name[:80]!r} has no place in a policy file.")
    if card.normalization is None:
        if moments:
            raise InputError("there is a normalisation that the card does not name; save it anew.")
        return PolicyFile(card, weights)
    sizes = sizes_of(card.observation)
    return PolicyFile(card, weights, Normalization.of_tensors(moments, sizes, **card.normalization))


def _versions(algorithm: str) -> dict[str, str]:
    packages = (*_VERSIONED, *(("sb3-contrib",) if algorithm == "RecurrentPPO" else ()))
    return {"python": platform.python_version(), **library_versions(packages)}
