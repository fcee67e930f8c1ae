"""Two ambiguity maps held against each other: two buildings, scanners or versions."""
