"""All that tasks, suites, terms of the reward and parts of the observation are made of.

Each has a record and a registry; docs/howto has a page for each.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ambinav.runtime.exports import exports

if TYPE_CHECKING:
    from ambinav_envs.buildings.suites import SUITES as SUITES
    from ambinav_envs.buildings.suites import Suite as Suite
    from ambinav_envs.observations import OBSERVATIONS as OBSERVATIONS
    from ambinav_envs.observations import ObservationPart as ObservationPart
    from ambinav_envs.observations import SizeParameters as SizeParameters
    from ambinav_envs.registration import TASKS as TASKS
    from ambinav_envs.rewards import REWARD_TERMS as REWARD_TERMS
    from ambinav_envs.rewards import RewardTerm as RewardTerm
    from ambinav_envs.robot_states import EpisodeEnd as EpisodeEnd
    from ambinav_envs.robot_states import Seen as Seen
    from ambinav_envs.robot_states import Stepped as Stepped
    from ambinav_envs.task_spec import DrawContext as DrawContext
    from ambinav_envs.task_spec import TaskSpec as TaskSpec
else:
    __all__, __getattr__, __dir__ = exports(__name__)
