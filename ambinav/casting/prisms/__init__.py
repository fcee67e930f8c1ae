"""Rays in space among walls and solids with heights over a floor plan."""
