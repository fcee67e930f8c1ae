"""Indistinguishability of scans, and the ambiguity of poses."""
