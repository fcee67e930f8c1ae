"""Comparison of scanners in a building, on the same floor and routes."""
