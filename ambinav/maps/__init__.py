"""Ambiguity maps: reading, sampling, storing and drawing them."""
