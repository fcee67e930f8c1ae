"""Readers of buildings: maps, floor plans, meshes and point clouds as environments."""
