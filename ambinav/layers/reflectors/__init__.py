"""Navigation by reflectors: which are seen, how precisely they fix the position, aliased poses."""
