"""Forecasts of a robot's error on a route, and of the probability that it gets lost."""
