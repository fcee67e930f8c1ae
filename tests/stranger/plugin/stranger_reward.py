"""A term of the reward: what is nearer than half a metre costs."""

from ambinav_envs.plugin import RewardTerm


def nearness(stepped):
    """Minus the metres that the nearest reading lacks to 0.5 m, shape (n,)."""
    nearest = stepped.seen.readings.min(axis=1).clip(0.0, 0.5)
    return nearest - 0.5


TERM = RewardTerm(
    name="nearness",
    unit="m",
    meaning="minus the metres that the nearest reading lacks to 0.5 m",
    function=nearness,
)
