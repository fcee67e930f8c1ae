"""Placement of posts, panels or tags that reduces bad floor most."""
