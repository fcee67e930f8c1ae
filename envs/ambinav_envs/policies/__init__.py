"""Policies from files, reactive ones, or from plug-ins, all with one interface."""

from ambinav_envs.policies.card import Card
from ambinav_envs.policies.file import read_card, save_policy
from ambinav_envs.policies.load import load_policy
from ambinav_envs.policies.normalization import Normalization
from ambinav_envs.policies.policy import ModelPolicy, Policy

__all__ = [
    "Card",
    "ModelPolicy",
    "Normalization",
    "Policy",
    "load_policy",
    "read_card",
    "save_policy",
]
