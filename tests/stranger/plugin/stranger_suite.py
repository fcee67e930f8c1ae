"""A suite: closets with a pillar, driven with good wheels and with worn ones."""

import numpy as np
import shapely

from ambinav import environment_from_shapes
from ambinav_envs.plugin import Suite


def closet(number, name):
    """A room of 8 m by 6 m; where the pillar stands depends on the number alone."""
    rng = np.random.default_rng([4711, number])
    x, y = rng.uniform((2.5, 2.0), (5.5, 4.0))
    pillar = shapely.box(x - 0.4, y - 0.4, x + 0.4, y + 0.4)
    return environment_from_shapes([shapely.box(0, 0, 8, 6)], [pillar], name=name)


SUITE = Suite(
    name="stranger-closets",
    title="a room with a pillar",
    draw=closet,
    conditions={"good wheels": {}, "worn wheels": {"odometry_scale": 3.0}},
    planners=("straight:0",),
    policies=("vfh",),
)
