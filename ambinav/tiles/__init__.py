"""Large maps, built tile by tile by several processes or machines, and resumed after a stop."""
