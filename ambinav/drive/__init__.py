"""Drives: a simulated robot follows a route with its localizer's estimates."""
