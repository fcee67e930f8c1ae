"""Maps that are made tile by tile: by several processes, on several machines, and gone on with."""
