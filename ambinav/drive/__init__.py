"""Drives: a simulated robot follows a route by what its localizer tells it."""
