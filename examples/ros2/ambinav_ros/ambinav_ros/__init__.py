"""Ambiguity maps in ROS 2; all but `node` runs without it."""
