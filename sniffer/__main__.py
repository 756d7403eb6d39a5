"""``python -m sniffer`` and the command ``sniffer``."""

from __future__ import annotations

import _signal  # type: ignore[import-not-found] # `signal` without its enumerations: 15 ms less
import os
import sys

TYPE_CHECKING = False  # of typing: nothing is loaded that can wait
if TYPE_CHECKING:
    from typing import Final, NoReturn

INTERRUPTED: Final = 130


def main() -> None:
    """Run the command line and exit with its status."""
    # What is needed takes half a second to load, and a library may make anything of an interrupt
    # in there. Nothing has begun by then: nothing is to be kept.
    before = _signal.signal(_signal.SIGINT, _leave)
    from sniffer.cli import run

    _signal.signal(_signal.SIGINT, before)
    sys.exit(run(sys.argv[1:]))


def _leave(number: int, frame: object) -> NoReturn:
    """End at once, with one line."""
    try:
        os.write(2, b"sniffer: interrupted\n")
    finally:
        os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()
