"""The layer `aliasing`: which other poses of the map give the same scan."""
