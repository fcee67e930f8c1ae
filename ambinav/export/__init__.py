"""Files for other programs: a registry of formats."""
