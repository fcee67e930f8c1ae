"""Environments: free space, wall segments, and rays cast against them."""
