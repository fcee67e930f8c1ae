"""The model compared with scans of real robots."""
