"""``python -m sniffer`` and the command ``sniffer``."""

from __future__ import annotations

import sys

from sniffer.ground.loading import Loading


def main() -> None:
    """Run the command line and exit with its status."""
    with Loading():
        from sniffer.cli import run

    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
