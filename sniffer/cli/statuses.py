"""Exit statuses of the command line."""

from __future__ import annotations

from typing import Final

DONE: Final = 0
MISTAKE: Final = 2
"""A call, an input or an output that cannot be."""
DAMAGED: Final = 3
"""The input broke off, or could not be read any more; what came before is written."""
INTERRUPTED: Final = 130
"""As shells tell of SIGINT."""
