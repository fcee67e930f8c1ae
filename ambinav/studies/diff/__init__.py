"""Comparison of two ambiguity maps: two buildings, scanners or versions."""
