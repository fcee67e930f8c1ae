"""A policy's network as plain values, and its reconstruction without imports by name."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Mapping
from itertools import pairwise
from typing import Annotated, Any, Final, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pydantic import Field

from ambinav.config import ConfigModel, checked, nearest
from ambinav.runtime.array_types import Floats32
from ambinav.runtime.errors import InputError

Weights = dict[str, Floats32]
Width = Annotated[int, Field(ge=1, le=1 << 16, strict=True)]
Widths = Annotated[tuple[Width, ...], Field(max_length=32)]
Few = Annotated[int, Field(ge=1, le=16, strict=True)]
Yes = Annotated[bool, Field(strict=True)]

ALGORITHMS: Final = ("PPO", "SAC", "RecurrentPPO")
MOST_WEIGHTS: Final = 1 << 24
"""Maximum number of parameters of a network: 64 MiB."""
Activation = Literal["Tanh", "ReLU", "ELU", "LeakyReLU", "SiLU", "GELU", "Sigmoid"]


class Features(ConfigModel):
    """Layers that process an observation before the shared layers.

    Attributes:
        kind: navigation: `ambinav_envs.training.features`, whose arguments are the others;
            combined and flatten: what Stable-Baselines3 does by default to parts and to a row.
    """

    kind: Literal["navigation", "combined", "flatten"]
    scan: Literal["conv", "dense"] = "conv"
    window: Literal["conv", "dense"] = "conv"
    scan_features: Width = 64
    window_features: Width = 64
    circular: Yes = True


class Branches(ConfigModel):
    """Widths of the separate layers of the actor (pi) and the critic (vf of PPO, qf of SAC)."""

    pi: Widths = ()
    vf: Widths | None = None
    qf: Widths | None = None


class Network(ConfigModel):
    """Arguments of a policy of Stable-Baselines3 that decide what it computes."""

    net_arch: Widths | Branches
    activation: Activation
    features: Features
    share_features_extractor: Yes
    use_sde: Yes = False
    squash_output: Yes = False
    full_std: Yes = True
    use_expln: Yes = False
    clip_mean: Annotated[float, Field(ge=0.0, le=1e6)] = 2.0
    n_critics: Few = 2
    lstm_hidden_size: Width | None = None
    n_lstm_layers: Few = 1
    shared_lstm: Yes = False
    enable_critic_lstm: Yes = True


_OWN: Final[Mapping[str, tuple[str, ...]]] = {
    "PPO": ("squash_output", "full_std"),
    "SAC": ("clip_mean", "n_critics"),
    "RecurrentPPO": (
        "squash_output", "full_std", "lstm_hidden_size", "n_lstm_layers", "shared_lstm",
        "enable_critic_lstm",
    ),
}  # fmt: skip
"""Which of the fields an algorithm has beside those that all have."""
_COMMON = ("use_sde", "use_expln", "share_features_extractor")


def network_of(model: Any) -> dict[str, Any]:
    """Describe the network of a trained model, for the card of its file.

    Raises:
        InputError: a policy file cannot hold it; the message gives the part.
    """
    algorithm, policy = type(model).__name__, model.policy
    kind = type(policy)
    root = kind.__module__.partition(".")[0]
    if root not in _PACKAGES or kind.__name__ not in _CLASSES[algorithm]:
        raise InputError(
            f"the policy is a {kind.__name__}, which a policy file cannot hold; use "
            f"{' or '.join(_CLASSES[algorithm])}."
        )
    arguments = dict(policy._get_constructor_parameters())
    arguments["share_features_extractor"] = policy.share_features_extractor
    if algorithm == "RecurrentPPO":
        if policy.lstm_kwargs:
            raise InputError("lstm_kwargs cannot be held by a policy file; leave them out.")
        layers, _, arguments["lstm_hidden_size"] = policy.lstm_hidden_state_shape
        arguments |= {
            "n_lstm_layers": layers,
            "shared_lstm": policy.shared_lstm,
            "enable_critic_lstm": policy.enable_critic_lstm,
        }
    names = (*_COMMON, *_OWN[algorithm])
    # None: not used without use_sde.
    chosen = {name: arguments[name] for name in names if arguments.get(name) is not None}
    activation = str(getattr(arguments["activation_fn"], "__name__", arguments["activation_fn"]))
    if arguments["activation_fn"] is not getattr(required("torch").nn, activation, None):
        raise InputError(
            f"the activation {activation} cannot be held by a policy file; use one of torch.nn."
        )
    plain = {
        "net_arch": _plain_arch(arguments["net_arch"]),
        "activation": activation,
        "features": _features_of(
            arguments["features_extractor_class"], arguments["features_extractor_kwargs"]
        ),
        **chosen,
    }
    parameters = checked(Network, plain, "the policy's network")
    _check_count(algorithm, parameters, model.observation_space, model.action_space)
    return plain


def weights_of(policy: Any) -> Weights:
    """Return the parameters of a policy by name, each once."""
    return {name: parameter.detach().cpu().numpy() for name, parameter in policy.named_parameters()}


def build_policy(
    algorithm: str,
    network: Mapping[str, Any],
    observation: spaces.Space[Any],
    action: spaces.Space[Any],
    weights: Mapping[str, NDArray[Any]],
) -> Any:
    """Build a policy of Stable-Baselines3 that computes the same as the saved one.

    Args:
        algorithm: One of `ALGORITHMS`.
        network: See `network_of`.
        observation: Observation space.
        action: Action space.
        weights: See `weights_of`.

    Returns:
        Something with `predict`, `observation_space` and `action_space`.

    Raises:
        InputError: a value is of no use, the weights are others than the network has, or a package
            is missing.
    """
    torch = required("torch")
    parameters = checked(Network, dict(network), "network")
    # Check before memory is allocated for them.
    _check_count(algorithm, parameters, observation, action)
    options = _options(algorithm, parameters)
    try:
        with torch.random.fork_rng(devices=[]):
            policy = _make(algorithm, observation, action, options)
    except InputError:
        raise
    except Exception as error:
        # Inconsistent arguments raise assertions in other packages.
        message = " ".join(str(error).split())[:200]
        raise InputError(
            f"network: it does not go with the spaces ({type(error).__name__}: {message})."
        ) from error
    expected = dict(policy.named_parameters())
    _check_weights(weights, {name: tuple(tensor.shape) for name, tensor in expected.items()})
    with torch.no_grad():
        for name, parameter in expected.items():
            parameter.copy_(torch.tensor(weights[name]))
    policy.set_training_mode(False)
    return policy


def _check_weights(
    weights: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int, ...]]
) -> None:
    for name in shapes:
        if name not in weights:
            raise InputError(f"weights: {name!r} is missing.")
    for name, array in weights.items():
        if name not in shapes:
            raise InputError(f"weights: {name[:80]!r} has no place in the network.")
        if array.dtype != np.float32:
            raise InputError(f"weights: {name!r} is {array.dtype}, not float32.")
        if array.shape != shapes[name]:
            raise InputError(
                f"weights: {name!r} has the shape {array.shape}, and the network {shapes[name]}."
            )
        if not np.isfinite(array).all():
            raise InputError(f"weights: {name!r} has numbers that are not finite.")


def _check_count(
    algorithm: str, network: Network, observation: spaces.Space[Any], action: spaces.Space[Any]
) -> None:
    if (count := _count(algorithm, network, observation, action)) > MOST_WEIGHTS:
        raise InputError(f"network: it has {count:,} weights or so, more than {MOST_WEIGHTS:,}.")


def _count(
    algorithm: str, network: Network, observation: spaces.Space[Any], action: spaces.Space[Any]
) -> int:
    """Return an upper bound of the number of weights of a network, without biases."""
    single = {"observation": observation}
    parts = observation.spaces if isinstance(observation, spaces.Dict) else single
    sizes = {name: int(np.prod(part.shape or (1,))) for name, part in parts.items()}
    features, weights = network.features, 0
    if features.kind == "navigation":
        for name, layers, width_of_part in (
            ("scan", features.scan, features.scan_features),
            ("window", features.window, features.window_features),
        ):
            if name in sizes:
                # Upper bound of the numbers that a convolution returns.
                weights += width_of_part * (
                    6 * (sizes[name] + 8) if layers == "conv" else sizes[name]
                )
                sizes[name] = width_of_part
    width = sum(sizes.values())
    memory = network.lstm_hidden_size or 0
    # Four gates, which look at what is seen and at what is remembered.
    recurrent = 4 * memory * (width + memory * (2 * network.n_lstm_layers - 1))
    actions = (
        int(action.n) if isinstance(action, spaces.Discrete) else int(np.prod(action.shape or ()))
    )
    count, seen = 2 * recurrent, memory or width
    if algorithm == "SAC":
        # Critics, and those that run after them, which see the action too.
        critic, times, out, count = seen + actions, 2 * network.n_critics, 2 * actions, 3 * weights
    else:
        critic, times, out, count = seen, 1, 2 * actions, count + 2 * weights
    arch = network.net_arch
    pi, critics = (
        (arch.pi, (arch.vf or (), arch.qf or ())) if isinstance(arch, Branches) else (arch, (arch,))
    )
    count += sum(a * b for a, b in pairwise((seen, *pi, out)))
    return count + times * sum(
        sum(a * b for a, b in pairwise((critic, *widths, 1))) for widths in critics
    )


def _make(
    algorithm: str,
    observation: spaces.Space[Any],
    action: spaces.Space[Any],
    options: Mapping[str, Any],
) -> Any:
    if algorithm == "SAC":
        kind = required("stable_baselines3.sac.policies").SACPolicy
    elif algorithm == "PPO":
        kind = required("stable_baselines3.common.policies").ActorCriticPolicy
    else:
        kind = required("sb3_contrib.common.recurrent.policies").RecurrentActorCriticPolicy
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return kind(observation, action, lambda _: 0.0, **options)


def _options(algorithm: str, network: Network) -> dict[str, Any]:
    """Return the arguments of the policy's class."""
    features, arch = network.features, network.net_arch
    arguments = features.model_dump(exclude={"kind"}) if features.kind == "navigation" else {}
    options: dict[str, Any] = {
        "net_arch": (
            {name: list(widths) for name, widths in arch if widths is not None}
            if isinstance(arch, Branches)
            else list(arch)
        ),
        "activation_fn": getattr(required("torch").nn, network.activation),
        "features_extractor_class": _extractors()[features.kind],
        "features_extractor_kwargs": arguments,
        **{name: getattr(network, name) for name in (*_COMMON, *_OWN[algorithm])},
    }
    if algorithm != "SAC":
        # The initial weights are replaced.
        options["ortho_init"] = False
    if algorithm == "RecurrentPPO" and network.lstm_hidden_size is None:
        raise InputError("network: lstm_hidden_size is missing.")
    return options


def _features_of(kind: Any, arguments: Mapping[str, Any]) -> dict[str, Any]:
    for name, extractor in _extractors().items():
        if kind is extractor and (name == "navigation" or not arguments):
            return {"kind": name, **arguments}
    names = [extractor.__name__ for extractor in _extractors().values()]
    raise InputError(
        f"the features extractor {kind.__name__} with arguments {dict(arguments)!r} cannot be held "
        f"by a policy file; {nearest(kind.__name__, names)}."
    )


def _extractors() -> dict[str, Any]:
    """Return the classes that `Features.kind` names."""
    layers = required("stable_baselines3.common.torch_layers")
    from ambinav_envs.training.features import NavigationFeatures

    return {
        "navigation": NavigationFeatures,
        "combined": layers.CombinedExtractor,
        "flatten": layers.FlattenExtractor,
    }


def _plain_arch(arch: Any) -> Any:
    if isinstance(arch, Mapping):
        return {name: list(widths) for name, widths in arch.items()}
    return list(arch)


_PACKAGES: Final = ("stable_baselines3", "sb3_contrib")
_CLASSES: Final[Mapping[str, tuple[str, ...]]] = {
    "PPO": ("ActorCriticPolicy", "MultiInputActorCriticPolicy"),
    "SAC": ("SACPolicy", "MultiInputPolicy"),
    "RecurrentPPO": ("RecurrentActorCriticPolicy", "RecurrentMultiInputActorCriticPolicy"),
}
"""Policies of Stable-Baselines3 and sb3-contrib that are built again."""


def required(module: str) -> Any:
    """Import a module that policy files need and that may not be installed.

    Raises:
        InputError: its package is missing.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        missing = (error.name or module).partition(".")[0]
        package = {"stable_baselines3": "stable-baselines3", "sb3_contrib": "sb3-contrib"}.get(
            missing, missing
        )
        raise InputError(
            f'a policy file needs {package}; run: pip install "ambinav[envs]" {package}.'
        ) from error
