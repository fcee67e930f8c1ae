"""Buildings to drive through: drawn suites, map files, their ambiguity maps, starts and goals."""
