"""Layers as pictures: pyramids of a map's layers, and tiles cut from them."""
