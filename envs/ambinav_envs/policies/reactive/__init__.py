"""Reactive baselines: policies that steer by their scan towards the waypoint, without learning."""
