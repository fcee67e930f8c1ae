"""Layers as pictures: pyramids of a map's layers, and tiles of them."""
