"""Policy files of the format before: what Stable-Baselines3 saved, read without what is pickled.

Their member `data` is JSON that holds pickled objects as text, and beside each of them what it is
in plain words. Those words are all that is read here; the weights are tensors, for which torch has
a reader of its own that makes nothing else (`weights_only`).
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ambinav.runtime.errors import InputError
from ambinav_envs.policies.archive import MEBIBYTE, UNREADABLE, check_inner
from ambinav_envs.policies.card import Card
from ambinav_envs.policies.network import required
from ambinav_envs.policies.normalization import ROW, Normalization

DATA: Final = "data"
POLICY: Final = "policy.pth"
MOMENTS: Final = "normalization.npz"
SIZES: Final = {DATA: 16 * MEBIBYTE, POLICY: 64 * MEBIBYTE, MOMENTS: MEBIBYTE}
"""Members that are read, and how large they may be."""
UNREAD: Final = (
    "pytorch_variables.pth", "policy.optimizer.pth", "actor.optimizer.pth", "critic.optimizer.pth",
    "ent_coef_optimizer.pth", "_stable_baselines3_version", "system_info.txt",
)  # fmt: skip
"""Members of Stable-Baselines3's that acting needs nothing of."""

# Arguments of a policy that say how it is trained, or what it begins with.
_TRAINING = ("optimizer_class", "optimizer_kwargs", "ortho_init", "log_std_init")
_DEFAULTS: dict[str, dict[str, Any]] = {
    "PPO": {"net_arch": {"pi": [64, 64], "vf": [64, 64]}, "activation": "Tanh"},
    "RecurrentPPO": {"net_arch": {"pi": [64, 64], "vf": [64, 64]}, "activation": "Tanh"},
    "SAC": {"net_arch": [256, 256], "activation": "ReLU"},
}
_MODULE = "torch.nn.modules.activation."
_FEATURES = {
    "ambinav_envs.training.features.NavigationFeatures": "navigation",
    "stable_baselines3.common.torch_layers.CombinedExtractor": "combined",
    "stable_baselines3.common.torch_layers.FlattenExtractor": "flatten",
}


def older_network(content: bytes, card: Card) -> dict[str, Any]:
    """The network of a model, see `network.network_of`, from the plain words in `data`.

    Raises:
        InputError: they do not tell it.
    """
    try:
        plain = json.loads(content)
        arguments = {k: v for k, v in plain["policy_kwargs"].items() if k[:1] != ":"}
        use_sde = plain.get("use_sde", False)
    except (ValueError, RecursionError, KeyError, TypeError, AttributeError) as error:
        raise InputError(f"{DATA} says nothing of the network; train the policy again.") from error
    for name in _TRAINING:
        arguments.pop(name, None)
    kind = _class_of(arguments.pop("features_extractor_class", None))
    default = "combined" if "parts" in card.observation else "flatten"
    chosen = _DEFAULTS[card.algorithm] | {
        "use_sde": use_sde,
        "share_features_extractor": card.algorithm != "SAC",
        "features": {
            "kind": default if kind is None else _FEATURES.get(kind, kind),
            **(arguments.pop("features_extractor_kwargs", None) or {}),
        },
    }
    if card.algorithm == "RecurrentPPO":
        chosen |= {"lstm_hidden_size": 256}
    if (activation := _class_of(arguments.pop("activation_fn", None))) is not None:
        chosen["activation"] = activation.removeprefix(_MODULE)
    return chosen | arguments


def older_weights(content: bytes, network: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """The parameters of a policy from `policy.pth`, each once.

    Layers that two parts share are there under several names.

    Raises:
        InputError: it is damaged, or holds something else.
    """
    torch = required("torch")
    check_inner(content, SIZES[POLICY], POLICY)
    try:
        found = torch.load(io.BytesIO(content), weights_only=True, map_location="cpu")
        # Shapes may be larger than what lies behind them.
        if sum(one.numel() * one.element_size() for one in found.values()) > 4 * SIZES[POLICY]:
            raise InputError(f"{POLICY} has more weights than a policy; train it again.")
        twice: tuple[str, ...] = ("pi_features_extractor.",)
        if network["share_features_extractor"]:
            twice += ("vf_features_extractor.", "critic.features_extractor.")
        return {
            str(name): one.detach().numpy().copy()
            for name, one in found.items()
            if not str(name).startswith(twice)
        }
    except InputError:
        raise
    except Exception as error:
        # Somebody else made it, and it may fail in any way.
        raise InputError(
            f"{POLICY} holds no weights alone ({type(error).__name__}); train the policy again."
        ) from error


def older_normalization(content: bytes, card: Card) -> Normalization:
    """The normalisation of observations from an .npz file.

    Raises:
        InputError: it is something else.
    """
    check_inner(content, SIZES[MOMENTS], "the normalisation")
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        clip, epsilon = float(arrays.pop("clip")), float(arrays.pop("epsilon"))
    except (*UNREADABLE, TypeError, MemoryError) as error:
        raise InputError(f"the normalisation cannot be read ({error}); save it anew.") from error
    tensors = {name.replace("_", ".", 1): value for name, value in arrays.items()}
    return Normalization.of_tensors(tensors, sizes_of(card.observation), clip, epsilon)


def sizes_of(observation: Mapping[str, Any]) -> dict[str, int]:
    """Sizes of the parts of an observation, see `Normalization.of_tensors`."""
    parts = observation.get("parts", {ROW: observation})
    return {name: int(part["size"]) for name, part in parts.items()}


def _class_of(text: object) -> str | None:
    """The name in "<class 'NAME'>"."""
    return None if text is None else str(text).removeprefix("<class '").removesuffix("'>")
