"""The leaderboard: planners and policies over the same episodes of the navigation environment."""
