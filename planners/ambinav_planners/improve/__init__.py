"""Improvement of a route after a search: the cost never rises, and the route stays free.

- `route`, with its kernels in `kernel` and `bezier`: shortcuts, a band, rounded corners.
- `shortcuts`, with the kernels in `moves`: shortcuts of flights, whose points are then moved.
- `limited`: the same under a limit on bad metres in a row.
- `finishing`: what follows every planner: improve, measure, or say why nothing was found.
"""
