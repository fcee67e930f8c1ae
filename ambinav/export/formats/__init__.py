"""Formats in which other programs read maps, one file each, all entries of the registry."""
