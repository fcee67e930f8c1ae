"""Readers of environments: occupancy grids and drawn floor plans, and the walls made of them."""
