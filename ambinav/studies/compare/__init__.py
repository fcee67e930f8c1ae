"""Comparing routes by what happens to a robot that drives them."""
