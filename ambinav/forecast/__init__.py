"""Forecasts: how far off a robot will be on a route, and how likely it gets lost."""
