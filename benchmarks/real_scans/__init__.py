"""The model held against scans of real robots."""
