"""Design studies: choice and mounting of the scanner, and changes of the building."""
