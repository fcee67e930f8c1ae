"""Motions between poses: straight lines, Dubins and Reeds-Shepp curves."""
