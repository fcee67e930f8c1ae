"""Store of computed maps, by content, in the user's cache folder."""
