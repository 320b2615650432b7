"""``python -m scanner_sim`` is ``scanner-sim``."""

from __future__ import annotations

from scanner_sim.cli import main

if __name__ == "__main__":
    main()
