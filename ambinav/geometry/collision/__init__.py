"""Collision checks for footprints: collision geometry, poses and motions, reachable floor."""
