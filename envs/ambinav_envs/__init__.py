"""Gymnasium plug-in of ambinav: navigation environments rewarded by the ambiguity map.

Importing it makes the ids known::

    import gymnasium as gym
    import ambinav_envs

    gym.register_envs(ambinav_envs)  # says to readers and linters that the import is of use
    env = gym.make("ambinav/Office-v1")

Other names are loaded when they are first used.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

try:
    import gymnasium as _gymnasium  # noqa: F401
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    raise ImportError(
        "ambinav_envs needs the package gymnasium, which is not installed; run "
        '`pip install "ambinav[envs]"`.'
    ) from None

from ambinav.runtime.exports import exports
from ambinav_envs import registration

if TYPE_CHECKING:
    from ambinav_envs.beliefs import Beliefs as Beliefs
    from ambinav_envs.beliefs import as_beliefs as as_beliefs
    from ambinav_envs.beliefs import belief_numbers as belief_numbers
    from ambinav_envs.beliefs import filter_belief as filter_belief
    from ambinav_envs.buffered import BufferedEnv as BufferedEnv
    from ambinav_envs.commands import as_actions as as_actions
    from ambinav_envs.commands import as_commands as as_commands
    from ambinav_envs.evaluation import Episodes as Episodes
    from ambinav_envs.leaderboard.dataset import record_datasets as record_datasets
    from ambinav_envs.leaderboard.evaluated import evaluate as evaluate
    from ambinav_envs.leaderboard.methods import follower_method as follower_method
    from ambinav_envs.leaderboard.methods import planner_method as planner_method
    from ambinav_envs.leaderboard.methods import policy_method as policy_method
    from ambinav_envs.navigation import NavigationEnv as NavigationEnv
    from ambinav_envs.parameters import NavigationParameters as NavigationParameters
    from ambinav_envs.policies.card import Card as Card
    from ambinav_envs.policies.driving import PolicyController as PolicyController
    from ambinav_envs.policies.file import read_card as read_card
    from ambinav_envs.policies.file import save_policy as save_policy
    from ambinav_envs.policies.load import load_policy as load_policy
    from ambinav_envs.policies.normalization import Normalization as Normalization
    from ambinav_envs.policies.policy import ModelPolicy as ModelPolicy
    from ambinav_envs.policies.policy import Policy as Policy
    from ambinav_envs.registration import IDS as IDS
    from ambinav_envs.registration import register_envs as register_envs
    from ambinav_envs.sb3 import NavigationVecEnv as NavigationVecEnv
    from ambinav_envs.sb3 import make_sb3 as make_sb3
    from ambinav_envs.training.config_file import load_training_config as load_training_config
    from ambinav_envs.training.train import train as train
    from ambinav_envs.vector import NavigationVectorEnv as NavigationVectorEnv
    from ambinav_envs.wrappers import Filtered as Filtered
    from ambinav_envs.wrappers import Flat as Flat
    from ambinav_envs.wrappers import FrameStack as FrameStack
else:
    __all__, __getattr__, __dir__ = exports(
        __name__, {"minari": "minari", **dict.fromkeys(("stable_baselines3", "torch"), "envs")}
    )

registration.register_envs()
