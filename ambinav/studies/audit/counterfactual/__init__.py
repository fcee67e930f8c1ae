"""Counterfactuals of an audit: the bad floor that remains after one change."""
