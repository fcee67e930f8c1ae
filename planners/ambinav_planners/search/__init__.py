"""Searches over graphs of free motions: lattice, roadmap, limits on bad stretches."""
