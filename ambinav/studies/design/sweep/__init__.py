"""Vary a scanner over a region, and tell which setting is best there."""
