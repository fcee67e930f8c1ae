"""Rays in the plane: a constrained triangulation to walk through, and a grid over the walls."""
