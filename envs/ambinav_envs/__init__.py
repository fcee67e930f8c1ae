"""Gymnasium plug-in of ambinav: navigation environments rewarded by the ambiguity map.

Importing it makes the ids known::

    import gymnasium as gym
    import ambinav_envs

    gym.register_envs(ambinav_envs)  # says to readers and linters that the import is of use
    env = gym.make("ambinav/Office-v0")
"""

try:
    import gymnasium as _gymnasium  # noqa: F401
except ModuleNotFoundError as error:
    if error.name != "gymnasium":
        raise
    raise ImportError(
        "ambinav_envs needs the package gymnasium, which is not installed; run "
        '`pip install "ambinav[envs]"`.'
    ) from None

from ambinav_envs.registration import IDS, register_envs

__all__ = ["IDS", "register_envs"]


def __dir__() -> list[str]:
    return sorted(__all__)


register_envs()
