"""Simulation of many robots in their buildings, all stepped together."""
