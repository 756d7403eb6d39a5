"""What an exchange is arranged with."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from sniffer.protocols.base import BusProtocol
    from sniffer.testing.facts import Known

FEW: Final = 2
"""Other exchanges that each one is arranged with, unless all are asked for."""

EVERY: Final = 10_000


class Others:
    """Chooses what an exchange is arranged with: always the same, spread over all there are.

    Only such as nothing else could be taken for: what is hard about an exchange is then its own.
    """

    def __init__(self, protocol: BusProtocol, known: Sequence[Known], *, thorough: bool) -> None:
        self.protocol = protocol
        self.known = [k for k in known if k.is_plain]
        self.few = EVERY if thorough else FEW
        self._turn = 0

    def some(self, fits: Callable[[Known], bool]) -> list[Known]:
        """Return a few that fit, other ones each time."""
        found = [k for k in self.known if fits(k)]
        if len(found) <= self.few:
            return found
        self._turn += 1
        first = self._turn * self.few % len(found)
        return (found + found)[first : first + self.few]

    def places(self, n: int, most: int) -> list[int]:
        """Return places 0..n-1: all of them, or ``most`` that are spread over them."""
        if n <= most or self.few == EVERY:
            return list(range(n))
        return sorted({k * (n - 1) // (most - 1) for k in range(most)})
