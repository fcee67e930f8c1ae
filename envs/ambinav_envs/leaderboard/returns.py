"""Comparison of returns, which is only meaningful between equal rewards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ambinav_envs.evaluation import Episodes
from ambinav_envs.parameters import NavigationParameters
from ambinav_envs.rewards import TERMS, weights_of


def reward_rule(parameters: NavigationParameters) -> dict[str, Any]:
    """Return everything in the configuration that a reward depends on; equal where rewards agree.

    A waypoint's `ambiguity_weight` is among them, since the term `progress` follows that route.
    """
    weights = {term: w for term, w in weights_of(parameters.reward).items() if w != 0.0}
    rule: dict[str, Any] = {"weights": weights}
    by_route = "progress" in weights or not set(weights) <= set(TERMS)
    if by_route:
        rule |= {"gamma": parameters.gamma, "ambiguity_weight": parameters.ambiguity_weight}
    if "ambiguity" in weights or (by_route and parameters.ambiguity_weight > 0.0):
        rule["layer"] = parameters.cost_layer
    return rule


def agreeing(
    episodes: Mapping[str, Episodes],
    parameters: Mapping[str, NavigationParameters],
    reference: NavigationParameters,
) -> dict[str, Episodes]:
    """Return the episodes; where rewards differ from the reference's, they become nan.

    Args:
        episodes: By method.
        parameters: Parameters of the environment that each drove in, by method.
        reference: Parameters whose reward counts.
    """
    rule = reward_rule(reference)
    return {
        name: driven
        if reward_rule(parameters[name]) == rule
        else replace(driven, reward=np.full(len(driven), np.nan))
        for name, driven in episodes.items()
    }
