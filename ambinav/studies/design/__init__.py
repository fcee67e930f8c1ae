"""Choose and mount the scanner of a building, and find what would help where it is lost."""
