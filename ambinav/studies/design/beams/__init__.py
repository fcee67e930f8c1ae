"""Reduction of beams: the smallest subset whose maps stay within a stated loss."""
