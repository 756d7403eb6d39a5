"""Which protocol is this? A candidate counts for what it explains that no better one explains.

Every candidate frames the same bytes, and each of its frames is held against those of the others:

    bytes          FF FF FF 01 02 F1 0B   (a mightyZAP ping)
    mightyzap     [0 ................. 7)  the container: counts
    dynamixel1       [1 .............. 7)  the same bytes less one FF: does not count

A frame inside a longer one of another protocol does not count. Nor does one that its own protocol
takes for unknown or malformed, if another one reads the very same bytes as it should. What holds
for both counts for both: a tie stays one, and is told. But where several frames of a protocol of
which there are more make up most of the longer one, that is the chance of one checksum against
those of many, and the longer one does not count:

    bytes          FF FF FF E0 FB A0 60 5B FF 44 01 45 FF .. .. .. FF .. .. .. FF ..
    wck                  [2 .......... 8)[8 ... 12)[12 ...)[...  dozens in a row
    mightyzap     [0 ............................................... 256)  one, of size FB

To compare how much each explains in all is not enough. Of a damaged mightyZAP stream Dynamixel 1
explains more: its frames are shorter, so more of them stay whole.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sniffer.decoding.beginnings import most_begun
from sniffer.decoding.names import AND
from sniffer.decoding.sums import wrong_sums
from sniffer.decoding.translations import translated
from sniffer.ground.chunks import ChunkColumns
from sniffer.ground.framing import Block
from sniffer.ground.model import MALFORMED, UNKNOWN, Chunk, InputError
from sniffer.ground.timing import Stamps
from sniffer.ground.wording import Sentence
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    from sniffer.ground.model import I64, U8, Mask
    from sniffer.protocols.base import BusProtocol

ENOUGH: Final = 32 * 1024
"""Bytes that are looked at: some thousand frames, a second of a busy bus."""

CLEAR: Final = 0.5
"""A share from which a protocol is taken if no other comes near."""

SURE: Final = "sure"
"""What is said of more than nine tenths of the bytes explained."""

LIKELY: Final = "likely"
"""What is said of less, from ``CLEAR`` on."""

GUESSED: Final = "not sure"
"""What is said of a much damaged capture."""

FEW: Final = 0.05
"""Below CLEAR, a much damaged capture is still taken from this share and three frames on."""

FRAMES: Final = 3
"""Frames that are no chance."""

MOST: Final = 0.5
"""Share of a frame that frames of another protocol within it make up where it is one by chance."""

BESIDE: Final = 0.05
"""Share of the bytes, all left over by the best, from which another protocol is heard beside it."""

OF_REST: Final = 0.5
"""Share that it must explain of what the best leaves over: damage leaves much, and wCK and LSS find
a frame in damage now and then."""

IMPOSSIBLE: Final = 0.5
"""What the share of a protocol counts for that cannot have the baud rate which was stated: a servo
may know rates that no manual lists, so it is less likely, not excluded."""

WORTH_TELLING: Final = 0.05
"""Share of the second best from which on it is named."""


@dataclass(frozen=True, slots=True)
class Detection:
    """The protocol found (``a+b``: two on one wire), how sure, and the share each candidate has.

    ``share`` is what of the bytes the protocol, or both of them, explain.
    """

    protocol: str
    certainty: str
    scores: Mapping[str, float]
    share: float

    def __str__(self) -> str:
        names = self.protocol.split(AND)
        told = f"explains {self.share:.1%} of the bytes"
        if len(names) > 1:
            told = f"explain {self.share:.1%} of the bytes, {_shares(self.scores, names)}"
        rest = [n for n in ranked(self.scores) if n not in names]
        if rest and self.scores[rest[0]] >= WORTH_TELLING:
            told += f"; {_shares(self.scores, rest[:1])}"
        return f"{self.protocol} ({self.certainty}: {told})"


def ranked(scores: Mapping[str, float]) -> list[str]:
    """Return the candidates, the best first."""
    return sorted(scores, key=lambda name: -scores[name])


def _shares(scores: Mapping[str, float], names: Iterable[str]) -> str:
    return ", ".join(f"{name} {scores[name]:.1%}" for name in names)


class Mistake(NamedTuple):
    """A bus that was said to speak ``named``, which explains only ``share`` of its bytes."""

    bus: str
    named: str
    share: float
    found: Detection

    def __str__(self) -> str:
        shown = f"only {self.share:.1%} of the bytes are frames" if self.share else "no frame"
        return f"{self.bus}: {shown} of {self.named}"


class UndecidedError(InputError):
    """No protocol explains the bytes well enough, or two do.

    ``likely`` names the one whose frames are meant although none holds; empty: nobody knows.
    ``likely_of`` has that by bus, for all buses whose protocol cannot be told, where it is known
    which these are. ``is_tie``: the frames of two hold alike, so nothing is
    wrong with the bytes. ``others``: there are buses that were decoded.
    """

    def __init__(
        self,
        told: str,
        *,
        likely: str = "",
        likely_of: Mapping[str, str] | None = None,
        is_tie: bool = False,
        others: bool = False,
    ) -> None:
        super().__init__(told)
        self.likely = likely
        self.likely_of = dict(likely_of or {})
        self.is_tie = is_tie
        self.others = others

    def of(self, name: str) -> UndecidedError:
        """Return the same of an input that is named: these bytes of ``name``; empty: of none."""
        return self._with(whose=f" of {name}" if name else "")

    def on(self, bus: str) -> UndecidedError:
        """Return the same of one bus of several."""
        return self._with(bus=f" on {bus}")

    def telling(self, told: str) -> UndecidedError:
        """Return the same in other words."""
        return UndecidedError(
            told,
            likely=self.likely,
            likely_of=self.likely_of,
            is_tie=self.is_tie,
            others=self.others,
        )

    def _with(self, **words: str) -> UndecidedError:
        told = self.args[0]
        told = told.told_of(**words) if isinstance(told, Sentence) else told
        return self.telling(told)


def told_of(undecided: Mapping[str, UndecidedError], *, others: bool) -> UndecidedError:
    """Return what is told of all buses whose protocol cannot be told: that of the first of them.

    ``others``: there are buses that were decoded.
    """
    bus, first = next(iter(undecided.items()))
    named = first.on(bus) if others or len(undecided) > 1 else first
    return UndecidedError(
        named.args[0],
        likely=named.likely,
        likely_of={each: e.likely for each, e in undecided.items()},
        is_tie=named.is_tie,
        others=others,
    )


def _hint(head: bytes) -> tuple[str, str]:
    """Return whose frames are meant though none holds, and what is to be done, as a template."""
    altered = translated(head, None)
    if altered is not None:
        return "", f"they are not as they were on a wire: {altered.what} ({altered.shown})"
    failed = wrong_sums(head, None)
    if failed is not None:
        return failed.protocol, f"name it with {{protocol}}; {failed}"
    begun = most_begun(head)
    if begun is not None:
        return begun.protocol, f"name it with {{protocol}}; {begun}"
    return "", "name it with {protocol}, or check that this is a bus capture"


class Scores:
    """What each candidate explains of the first bytes of some chunks.

    Args:
        chunks: what was heard; ``ENOUGH`` bytes of it are looked at.
        baud: bits per second, where somebody stated them.
        also: protocols beside those that are looked for where none is named.
    """

    def __init__(
        self,
        chunks: Sequence[Chunk],
        baud: int | None = None,
        also: Sequence[BusProtocol] = (),
    ) -> None:
        taken = _first(chunks)
        heard = b"".join(c.data for c in taken)
        self.size = len(heard)
        self._data = heard
        each = {p.name: p for p in (*PROTOCOLS.candidates(heard), *also)}
        told, data = ChunkColumns(taken), np.frombuffer(heard, np.uint8)
        self._heard = {name: _Heard(p, told, data) for name, p in each.items()} if taken else {}
        for mine in self._heard.values():
            for other in self._heard.values():
                if other is not mine:
                    mine.yield_to(other)
        none = dict.fromkeys(PROTOCOLS.built_in if taken else (), 0.0)  # also who was not loaded
        self.shares = {**none, **{n: heard.bytes / self.size for n, heard in self._heard.items()}}
        """By name: the share of the bytes that this candidate explains and no better one does."""
        self._weights = {
            name: self.shares[name] * (IMPOSSIBLE if baud and baud not in heard.bauds else 1)
            for name, heard in self._heard.items()
        }

    def share_of(self, name: str) -> float:
        """Return the share of the bytes that a protocol explains, or those of ``a+b`` together."""
        return min(1.0, sum(self.shares.get(one, 0.0) for one in name.split(AND)))

    def begin(self, names: Iterable[str]) -> int:
        """Return where the first frame begins that counts for some candidates; 0: there is none."""
        firsts = [h.start[h.counts] for name, h in self._heard.items() if name in set(names)]
        return min((int(first[0]) for first in firsts if len(first)), default=0)

    def best(self) -> Detection:
        """Return the protocol that explains the bytes, or the two that share them.

        Raises:
            UndecidedError: it cannot be told; the message shows the best.
        """
        if not self.size:
            raise UndecidedError("the input has no bytes: nothing to decode")
        names = ranked(self._weights)
        found = self._found(names[0], names[1:]) if names else None
        if found is not None:
            return found
        shown = _shares(self.shares, [n for n in names[:2] if self.shares[n] >= 0.001])
        why = f" ({shown or 'none explains any of them'})"
        is_tie = bool(names) and self.shares[names[0]] >= CLEAR
        likely, told = ("", "name it with {protocol}") if is_tie else _hint(self._data)
        these = "this {size} byte" if self.size == 1 else "these {size} bytes"
        told = f"cannot tell the protocol of {these}{{bus}}{{whose}}{{why}}: {told}"
        told = Sentence(told, size=self.size, bus="", whose="", why=why)
        raise UndecidedError(told, likely=likely, is_tie=is_tie)

    def _found(self, first: str, others: Sequence[str]) -> Detection | None:
        """Return what the best candidate is taken for, if it is clear enough that it is that."""
        weights = self._weights
        share, second = self.shares[first], weights[others[0]] if others else 0.0
        both = self._beside(first, others)
        if both is not None:
            return both
        if share >= CLEAR and weights[first] >= 1.5 * second:
            return Detection(first, SURE if share > 0.9 else LIKELY, self.shares, share)
        frames = int(self._heard[first].counts.sum())
        if share >= FEW and frames >= FRAMES and weights[first] >= 4 * second:
            return Detection(first, GUESSED, self.shares, share)
        return None

    def _beside(self, first: str, others: Sequence[str]) -> Detection | None:
        """Return the best with another one that explains much of what it leaves over."""
        best = self._heard[first]
        left = 1 - best.bytes / self.size
        if left < BESIDE or int(best.counts.sum()) < FRAMES:
            return None
        more = {name: self._heard[name].apart_from(best) for name in others}
        name = max(others, key=lambda n: more[n][0] * self._weights[n], default=None)
        if name is None:
            return None
        share, frames = more[name][0] / self.size, more[name][1]
        whole = 1 - left + share
        if frames < FRAMES or share < max(BESIDE, OF_REST * left) or whole < CLEAR:
            return None
        names = AND.join(sorted((first, name)))
        return Detection(names, SURE if whole > 0.9 else LIKELY, self.shares, whole)


class _Heard:
    """The frames that one candidate sees; ``counts`` tells which of them count for it."""

    def __init__(self, protocol: BusProtocol, chunks: ChunkColumns, data: U8) -> None:
        silences = Stamps(protocol.baud, protocol.tail_ns).take(chunks)
        self._protocol, self._block = protocol, Block(data, silences, True)
        self._spans, _ = protocol.frame(self._block)
        self._sound: Mask | None = None
        self.bauds = protocol.bauds
        self.start: I64 = self._spans.start
        self.end: I64 = self._spans.end
        self.counts: Mask = np.ones(len(self._spans), bool)

    @property
    def sound(self) -> Mask:
        """Which frames are as their own protocol has them; rarely asked, and not cheap to tell."""
        if self._sound is None:
            flags = self._protocol.describe(self._block, self._spans).flags
            self._sound = flags & (MALFORMED | UNKNOWN) == 0
        return self._sound

    @property
    def bytes(self) -> int:
        """Bytes in the frames that count."""
        return int((self.end - self.start)[self.counts].sum())

    def yield_to(self, other: _Heard) -> None:
        """Count no frame that another candidate explains better: within a longer one, or alone."""
        if not len(other.start):
            return
        row = np.searchsorted(other.start, self.start, "right") - 1
        inside = (row >= 0) & (other.end[row] >= self.end)
        same = (other.start[row] == self.start) & (other.end[row] == self.end)
        if same.any():
            inside &= np.where(same, other.sound[row] & ~self.sound, True)
        if len(self.start) > len(other.start):
            chance = self._makes_up(other, row, inside)
            other.counts &= ~chance
            inside &= ~chance[row]
        self.counts &= ~inside

    def _makes_up(self, other: _Heard, row: I64, inside: Mask) -> Mask:
        """Return which frames of another candidate are ``FRAMES`` of this one and little else."""
        within, rows = row[inside], len(other.start)
        filled = np.bincount(within, (self.end - self.start)[inside], rows)
        longest = (other.end - other.start) * MOST
        return (np.bincount(within, minlength=rows) >= FRAMES) & (filled >= longest)

    def apart_from(self, other: _Heard) -> tuple[int, int]:
        """Return how many bytes are in frames that count and touch none of another, and those."""
        edges = np.sort(np.concatenate([other.start[other.counts], other.end[other.counts]]))
        row = np.searchsorted(edges, self.start, "right")
        apart = self.counts & (row % 2 == 0)
        apart &= np.searchsorted(edges, self.end, "left") == row
        return int((self.end - self.start)[apart].sum()), int(apart.sum())


def _first(chunks: Sequence[Chunk]) -> list[Chunk]:
    """Return the chunks up to ``ENOUGH`` bytes, without their marks."""
    taken: list[Chunk] = []
    size = 0
    for chunk in chunks:
        if size >= ENOUGH:
            break
        part = chunk.data[: ENOUGH - size]
        if part:
            is_as_it_is = not chunk.marks and len(part) == len(chunk.data)
            taken.append(chunk if is_as_it_is else Chunk(part, chunk.t_ns, chunk.clock))
        size += len(part)
    return taken


def detect(chunks: Sequence[Chunk], baud: int | None = None) -> Detection:
    """Return the protocol of the chunks; ``baud`` is the rate where somebody stated it.

    Raises:
        UndecidedError: it cannot be told; the message shows the best.
    """
    return Scores(chunks, baud).best()


def latest(chunks: Sequence[Chunk], size: int) -> list[Chunk]:
    """Return the last chunks, of about so many bytes."""
    taken, held = 0, 0
    while taken < len(chunks) and held < size:
        taken += 1
        held += len(chunks[-taken].data)
    return list(chunks[len(chunks) - taken :])
