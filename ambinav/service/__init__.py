"""Queries of planners and environments to an ambiguity map: cost, reward, gradient."""
