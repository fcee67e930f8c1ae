"""Where a footprint fits and along which motions: collision geometry, checks, reachable floor."""
