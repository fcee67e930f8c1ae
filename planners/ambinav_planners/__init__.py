"""OMPL plug-in of ambinav: planners that weigh a route's length against its ambiguity."""
