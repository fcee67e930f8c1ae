"""The layer `aliasing`: other poses of the map that give the same scan."""
