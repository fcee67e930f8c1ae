"""The store: maps that were computed before, kept by content in the user's cache folder."""
