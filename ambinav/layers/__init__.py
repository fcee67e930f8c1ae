"""Layers: measures of localizability on the lattice of an ambiguity map."""
