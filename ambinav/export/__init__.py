"""Exports for other programs: a registry of formats."""
