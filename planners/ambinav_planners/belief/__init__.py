"""Planners that predict the localizer's covariance along the route."""
