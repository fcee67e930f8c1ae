"""Logs of robots: read, made into maps, replayed, and written for other people's tools."""
