"""Improvement of routes after a search: cheaper, never dearer, always free."""
