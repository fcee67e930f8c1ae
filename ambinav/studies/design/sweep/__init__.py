"""Variation of a scanner's settings over a region, to find the best one there."""
