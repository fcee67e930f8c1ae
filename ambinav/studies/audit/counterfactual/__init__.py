"""Counterfactuals of an audit: what the bad floor would be with one thing changed."""
