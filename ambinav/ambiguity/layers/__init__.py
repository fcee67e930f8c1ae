"""Layers of other measures of localizability, on the same lattice as the ambiguity."""
