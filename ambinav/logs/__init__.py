"""Robot logs: reading, mapping, replay, and export for other tools."""
