"""Clues and moves of a pass, in order: from which rows on which servo is read by which table."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.anomalies.evidence import Evidence
from sniffer.anomalies.learned import MetClue, Told
from sniffer.decoding.changes import new_id
from sniffer.ground.codes import REQUEST
from sniffer.ground.memory import Remembering

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.anomalies.learned import Change
    from sniffer.ground.framing import Block
    from sniffer.ground.model import I64, Frames, Mask
    from sniffer.protocols.base import BusProtocol, Sightings, State, Turn

SHOWN: Final = 6
"""So many clues are kept for a servo, the latest, to be shown with what was decided."""


@dataclass(slots=True)
class Verdicts:
    """What a pass turned: ``anew`` are the turns by which a servo is read by another table."""

    turns: list[Turn] = field(default_factory=list)
    anew: list[Turn] = field(default_factory=list)
    told: list[Told] = field(default_factory=list)


class Weighing(Remembering):
    """Walks the clues and the new ids of a pass."""

    LASTING = ("_met",)
    PARTS = ("_evidence",)

    def __init__(self, protocol: BusProtocol, state: State) -> None:
        self._protocol = protocol
        self._evidence = Evidence(protocol, state)
        self._met: dict[int, tuple[MetClue, ...]] = {}

    def weigh(
        self,
        block: Block,
        frames: Frames,
        sightings: Sightings | None,
        accepted: Mask,
        changes: Sequence[Change],
        base: int,
    ) -> Verdicts:
        """Count clues and move what is known of servos; the state ends as the pass ends.

        Args:
            block: the bytes that the clues stand in, to be shown.
            frames: all rows of the pass.
            sightings: the clues, by row; None: there are none.
            accepted: for each frame whether what it says became true.
            changes: what the pass changes about servos; only new ids count here.
            base: offset in the stream of the block's first byte.
        """
        moves = [c for c in changes if new_id(c) >= 0]
        out = Verdicts()
        if sightings is None and not moves:
            return out
        # What is walked, in order: (row, is it a move, number). The sightings of the example in
        # ``_news`` stand in rows 0, 1, 3 and 6, and at row 1 servo 1 turns. In a row that is a clue
        # and a move, the clue comes first: it speaks of the servo as it was called until then.
        todo: list[tuple[int, int, int]] = [(c.row, 1, i) for i, c in enumerate(moves)]
        if sightings is not None:
            todo += [
                (int(sightings.row[i]), 0, i)
                for i in self._news(frames, sightings, accepted, all_of_them=bool(moves))
            ]
        todo.sort()
        for (row, is_move), entries in itertools.groupby(todo, key=lambda e: e[:2]):
            if is_move:
                for _, _, i in entries:
                    self._move(moves[i], out)
                continue
            assert sightings is not None
            # the clues of one row are one decision
            news = [i for _, _, i in entries if self._count(block, frames, sightings, i, base)]
            if news:
                self._settle(row, row, [int(sightings.servo_id[i]) for i in news], out)
        return out

    def _news(
        self, frames: Frames, s: Sightings, accepted: Mask, *, all_of_them: bool
    ) -> list[int]:
        """Return the clues that count: not those of refused frames, none a servo gave before."""
        # Clues repeat with every packet, and each counts once a servo. Two registers that only the
        # 12Lf has are written to servo 1 again and again, the second to servo 2, and then read
        # back:
        #
        #     sighting  0    1    2    3    4    5
        #     row       0    1    2    3    4    6
        #     servo     1    1    1    2    1    1
        #     clue      0    1    0    1    0    2       2: the answer that has the second register
        #     asked     1    1    1    1    1    0
        #     key       257  769  257  770  257  1025    clue, asked and id in one number
        #     first     0    1         3         5       2 and 4 are the first one again
        #
        # Only those of ``first`` are looked at one by one. ``place`` has a cell for every key there
        # can be (1536 here); it is filled from the last to the first, so what stays is the first of
        # each. np.unique would say the same and sort all sightings for it. With a move among the
        # changes the id in a key does not name one servo throughout the block, so then all of them
        # are looked at.
        asked = frames.kind[s.row] == REQUEST
        status = frames.status[s.row]
        told = np.where(asked, accepted[s.row], (status < 0) | ~self._protocol.refused(status))
        good: I64 = np.flatnonzero(told)
        if all_of_them or not len(good):
            return list(map(int, good))
        key = (s.clue[good] << 1 | asked[good]) << 8 | (s.servo_id[good] & 255)
        place = np.full(len(s.clues) << 9, -1)
        place[key[::-1]] = np.arange(len(key))[::-1]  # the first of each
        first = np.sort(place[place >= 0])
        out = []
        for i in good[first].tolist():
            servo, clue = int(s.servo_id[i]), s.clues[int(s.clue[i])]
            to_all = self._is_to_all(frames, int(s.row[i]), servo)
            if self._evidence.is_news(servo, clue, to_all=to_all):
                out.append(i)
        return out

    def _is_to_all(self, frames: Frames, row: int, servo: int) -> bool:
        return servo in self._protocol.everyone and int(frames.kind[row]) == REQUEST

    def _count(self, block: Block, frames: Frames, s: Sightings, i: int, base: int) -> bool:
        row, servo, clue = int(s.row[i]), int(s.servo_id[i]), s.clues[int(s.clue[i])]
        at, to_all = int(s.at[i]), self._is_to_all(frames, row, servo)
        if not self._evidence.weigh(servo, clue, to_all=to_all):
            return False
        data = block.data[at : at + min(clue.width, 16)].tobytes()
        span = base + int(frames.start[row]), int(frames.length[row])
        met = MetClue(clue, data, int(frames.op[row]), span)
        for who in range(256) if to_all else (servo & 255,):
            self._met[who] = (*self._met.get(who, ()), met)[-SHOWN:]
        return True

    def _move(self, change: Change, out: Verdicts) -> None:
        if not self._evidence.knows:
            return
        new = new_id(change)
        self._evidence.move(change.servo, new)
        self._met[new] = self._met.get(change.servo & 255, ())
        self._settle(change.row, change.row + 1, [new], out)

    def _settle(self, row: int, since: int, servos: Sequence[int], out: Verdicts) -> None:
        """Decide at ``row`` what holds ``since`` a row."""
        before = self._evidence.state.model.copy()
        turns, verdicts = self._evidence.settle(since, servos)
        out.turns += turns
        if since == row:
            out.anew += [t for t in turns if t.model != before[t.servo]]
        out.told += [Told(row, v, self._met.get(v.servo, ())) for v in verdicts]
