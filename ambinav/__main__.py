"""`python -m ambinav`: the command line, where the command `ambinav` is not on the path."""

from __future__ import annotations

from ambinav.cli import main

if __name__ == "__main__":
    main()
