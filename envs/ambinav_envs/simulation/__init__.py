"""Many robots in their buildings, one step of all of them at a time."""
