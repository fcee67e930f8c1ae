"""Studies of a building or a map: audit, comparison of routes, difference of maps, design."""
