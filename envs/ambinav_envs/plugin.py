"""All that a term of the reward or a part of the observation is made of, and their registries."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambinav.runtime.exports import exports

if TYPE_CHECKING:
    from ambinav_envs.observations import OBSERVATIONS as OBSERVATIONS
    from ambinav_envs.observations import ObservationPart as ObservationPart
    from ambinav_envs.observations import SizeParameters as SizeParameters
    from ambinav_envs.rewards import REWARD_TERMS as REWARD_TERMS
    from ambinav_envs.rewards import RewardTerm as RewardTerm
    from ambinav_envs.robot_states import Seen as Seen
    from ambinav_envs.robot_states import Stepped as Stepped
else:
    __all__, __getattr__, __dir__ = exports(__name__)
