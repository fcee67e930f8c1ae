"""Layouts of reflectors for robots that navigate by them."""
