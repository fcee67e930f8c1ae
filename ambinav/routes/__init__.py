"""Routes: what a planner returns, what they cost, how they are stored, compared and drawn."""
