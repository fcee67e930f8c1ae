"""`python -m ambinav.cli`."""

from __future__ import annotations

from ambinav.cli import main

if __name__ == "__main__":
    main()
