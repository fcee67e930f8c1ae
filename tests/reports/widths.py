"""Widths of a page in a browser."""

SIZES = "() => [document.documentElement.scrollWidth, document.documentElement.clientWidth]"
"""Script that gives the width of all that is on the page, and that of the window."""
