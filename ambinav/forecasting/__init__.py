"""How far off, and how likely lost, a robot will be on a route."""
