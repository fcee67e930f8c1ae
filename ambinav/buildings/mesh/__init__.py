"""Readers of meshes, point clouds and OctoMaps: units, levelling, free floor."""
