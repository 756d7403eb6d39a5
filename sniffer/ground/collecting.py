"""How often Python looks for objects that hold each other: seldom in commands, as usual live.

What a command loads are some 100,000 objects that stay. By itself Python looks through them 150
times while they come, which is 9 % of decoding a small capture, and finds a thousand to free.
"""

from __future__ import annotations

import gc

TYPE_CHECKING = False  # of typing: nothing is loaded that can wait
if TYPE_CHECKING:
    from typing import Final, Self

USUAL: Final = gc.get_threshold()

SELDOM: Final = 250_000
"""So many objects more than at the last look are there at the next one. What nothing holds is freed
at once all the same."""


def collect_seldom() -> None:
    """Look seldom from now on. To be called in a process that is this program's own."""
    gc.set_threshold(SELDOM, *USUAL[1:])


class Promptly:
    """While it lasts, Python looks as often as it usually does, through a little each time.

    A look at 100,000 objects keeps all threads waiting for as long as some bytes are on the wire.
    Use it with ``with`` where something is due at its time.
    """

    def __enter__(self) -> Self:
        self._before = gc.get_threshold()
        gc.set_threshold(*USUAL)
        return self

    def __exit__(self, *_: object) -> None:
        gc.set_threshold(*self._before)
