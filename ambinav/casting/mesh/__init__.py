"""Rays in space against triangles, through Embree."""
