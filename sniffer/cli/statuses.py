"""Exit statuses of the command line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sniffer.jobs.session import Ending

DONE: Final = 0
MISTAKE: Final = 2
"""A call, an input or an output that cannot be."""
DAMAGED: Final = 3
"""The input broke off, or could not be read any more; what came before is written."""
INTERRUPTED: Final = 130
"""As shells tell of SIGINT."""


def status_of(ending: Ending, *, is_lost: bool = False) -> int:
    """Return the status of how a source ended; ``is_lost``: an output is gone."""
    of = {"MISTAKEN": MISTAKE, "DAMAGED": DAMAGED, "INTERRUPTED": INTERRUPTED}
    return of.get(ending.name, MISTAKE if is_lost else DONE)
