"""Loads the kernels that most scripts run: a module for `tests.forked.ForkServer`."""

import ambinav as an
from ambinav_planners import RoutePlanner

for name in ("turtlebot3-lds", "hokuyo-urg-04lx"):  # all around, and with headings
    amap = an.build_map(
        an.load_environment(an.DEMO_BUILDING), an.RangeScanner.from_preset(name), spacing=0.5
    )
    RoutePlanner(amap).plan(an.DEMO_START, an.DEMO_GOAL, planner_name="reference")
