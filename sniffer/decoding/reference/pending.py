"""Which request does an answer belong to? The slow way, one frame after the other: what is right.

Several requests may be open at once. A request is open to an answer that begins behind it, in the
same stretch between two silences, within the protocol's ``reach``, and while fewer than ``DEPTH``
other requests that ask have followed it. What the two carry must agree: the servo's id and the
token (a length, an address and length, a word). Together they are the *key*.

- A request that others may answer (``alt_id``) takes the id of the first answer that fits it; an
  answer that fits any token takes that of the latest request to its servo.
- Within a key, requests and then answers are a *run*; the next request begins another. Of a run
  the LAST requests get the FIRST answers, in order: so the answer of a retry is the retry's, where
  first-in, first-out would shift all that follow by one. An answer counts while the request it
  would serve, were it the last that counts, is open: the one as far from the end of the requests
  as it is from the beginning of the answers.
- A request to all (``MANY``) ends the runs of its token. What is left over is the latest one's that
  it fits; right behind a request that has no answer it is that one's, but does not fit it.
- What a servo says ``ON_ITS_OWN`` answers nobody, wherever it stands.

Where answers name nobody (``ordered``), they stand behind their requests as framing put them: of m
answers in a row, the last m requests before them get one each.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.ground.codes import MANY, MISMATCHED, NEVER, OK, ON_ITS_OWN, REQUEST, UNSOLICITED
from sniffer.ground.model import ANY_ID, DEPTH, NO_ALT

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from sniffer.protocols.base import SlowFrame

Key = tuple[int, int]
Match = tuple[int, int, int]
"""The row of an answer, that of its request (-1 for none), and the outcome."""


def matched(frames: Sequence[SlowFrame], reach: int, *, ordered: bool = False) -> list[Match]:
    """Return what each answer of one stretch belongs to, in wire order."""
    if ordered:
        return list(_by_order(frames))
    return _Pending(frames, reach).matches()


def _by_order(frames: Sequence[SlowFrame]) -> Iterator[Match]:
    at = 0
    while at < len(frames):
        stop = at
        while stop < len(frames) and frames[stop].kind != REQUEST:
            stop += 1
        for row in range(at, stop):
            asked = row - (stop - at)
            fits = asked >= 0 and frames[asked].kind == REQUEST and frames[asked].reply != NEVER
            yield (row, asked, OK) if fits else (row, -1, UNSOLICITED)
        at = stop + 1


class _Pending:
    """The frames of one stretch, and which of its requests are open when."""

    def __init__(self, frames: Sequence[SlowFrame], reach: int) -> None:
        self.frames, self.reach = frames, reach
        self.asked: list[int] = []  # requests that ask, up to and with each row
        for f in frames:
            before = self.asked[-1] if self.asked else 0
            self.asked.append(before + (f.kind == REQUEST and f.reply != NEVER))
        self.answers = [row for row, f in enumerate(frames) if f.kind != REQUEST]

    def asks(self, row: int) -> bool:
        f = self.frames[row]
        return f.kind == REQUEST and f.reply not in (NEVER, MANY)

    def asks_all(self, row: int) -> bool:
        f = self.frames[row]
        return f.kind == REQUEST and f.reply == MANY

    def is_open(self, request: int, answer: int) -> bool:
        near = self.frames[answer].start - self.frames[request].end <= self.reach
        return request < answer and near and self.asked[answer] - self.asked[request] < DEPTH

    def names(self, request: int, answer: int) -> bool:
        """Tell whether the servo that answers is one that was asked."""
        q, who = self.frames[request], self.frames[answer].servo_id
        return who == q.servo_id or q.alt_id == ANY_ID or (q.alt_id == who and who != NO_ALT)

    def fits(self, request: int, answer: int) -> bool:
        q, r = self.frames[request], self.frames[answer]
        return self.names(request, answer) and r.token in (-1, q.token)

    def is_own(self, request: int, answer: int) -> bool:
        """Tell whether a servo was asked by name behind a request to any, before it answers."""
        return self.frames[request].alt_id == ANY_ID and any(
            self.asks(q) and self.frames[q].alt_id == NO_ALT and self.fits(q, answer)
            for q in range(request + 1, answer)
        )

    def key(self, row: int) -> Key | None:
        """Return servo and token; None for a frame that nothing can be the counterpart of."""
        f = self.frames[row]
        if self.asks(row):
            if f.alt_id == NO_ALT:
                return f.servo_id, f.token
            for r in self.answers:
                if self.is_open(row, r) and self.fits(row, r) and not self.is_own(row, r):
                    return self.frames[r].servo_id, f.token
            return None
        if f.token != -1:
            return f.servo_id, f.token
        for q in reversed(range(row)):
            if self.asks_all(q):
                return None
            if self.asks(q) and self.is_open(q, row) and self.names(q, row):
                return f.servo_id, self.frames[q].token
        return None

    def runs(self) -> Iterator[tuple[list[int], list[int]]]:
        """Yield the requests and the answers of each run."""
        current: dict[Key, tuple[list[int], list[int]]] = {}
        for row, f in enumerate(self.frames):
            if self.asks_all(row):
                for ended in [k for k in current if k[1] == f.token]:
                    yield current.pop(ended)
                continue
            if f.kind == REQUEST and not self.asks(row):
                continue
            key = self.key(row)
            if key is None:
                continue
            if self.asks(row) and key in current and current[key][1]:
                yield current.pop(key)
            current.setdefault(key, ([], []))[0 if self.asks(row) else 1].append(row)
        yield from current.values()

    def matches(self) -> list[Match]:
        asked_by: dict[int, int] = {}
        for asked, answers in self.runs():
            n = 0
            while n < min(len(asked), len(answers)) and self.is_open(asked[-1 - n], answers[n]):
                n += 1
            asked_by.update(zip(answers[:n], asked[len(asked) - n :], strict=True))
        taken = set(asked_by.values())
        return [
            (r, asked_by[r], OK) if r in asked_by else self.left_over(r, taken)
            for r in self.answers
        ]

    def left_over(self, answer: int, taken: set[int]) -> Match:
        """Return what an answer is that no request to its servo is open for."""
        if self.frames[answer].token == ON_ITS_OWN:
            return answer, -1, UNSOLICITED
        for q in reversed(range(answer)):
            if self.asks_all(q) and self.is_open(q, answer) and self.fits(q, answer):
                return answer, q, OK
        last = next((q for q in reversed(range(answer)) if self.frames[q].kind == REQUEST), -1)
        if last >= 0 and self.is_open(last, answer):
            behind = last == answer - 1 and self.asks(last) and last not in taken
            if behind or self.asks_all(last):
                return answer, last, MISMATCHED
        return answer, -1, UNSOLICITED
