"""Gymnasium plug-in of ambinav: navigation environments rewarded by the ambiguity map."""
