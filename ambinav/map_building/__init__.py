"""Ambiguity maps: build them with their layers, store them, update them after a change."""
