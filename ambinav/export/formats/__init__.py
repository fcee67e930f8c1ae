"""Export formats that other programs read, one module each, all entries of the registry."""
