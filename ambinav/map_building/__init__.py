"""Build ambiguity maps with their layers, keep them, and update them after a change."""
