"""Fewer readings: the smallest subset of a scanner's beams whose maps stay within a stated loss."""
