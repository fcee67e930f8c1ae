"""Planners that predict the localizer's covariance along the route.

- `model`, `information`: what is supposed of the robot, and what a scan tells it over the map.
- `lattice_search`: cell and standard deviation together, over the lattice.
- `transfer`, `roadmap`, `roadmap_search`: covariances of the pose over a roadmap.
- `planners`: both searches as planners of the registry.
"""
