"""Rays against the walls: constrained triangulation, whole scans, single rays, clearances."""
