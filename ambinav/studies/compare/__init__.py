"""Comparison of routes by simulated drives along them."""
