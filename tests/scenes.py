"""What a decoder sees of a scenario, in plain rows: for tests that look for what is built in."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING, NamedTuple

from sniffer.decoding.decoder import Decoder
from sniffer.ground.codes import OK, REQUEST, WHOLE
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.protocols import PROTOCOLS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bench.diagnosis.scenario import Heard, Scenario


class Asked(NamedTuple):
    """A request; ``took_s`` until it was answered, None where it was not."""

    t_s: float
    servo_id: int
    op: str
    raw: bytes
    took_s: float | None


class Stated(NamedTuple):
    """A value, as it was on the wire; ``quantity`` is empty where the register has none."""

    t_s: float
    servo_id: int
    name: str
    quantity: str
    raw: int
    is_whole: bool


class Seen(NamedTuple):
    """All of it, in order; ``said`` are the answers, ``codes`` the anomalies."""

    heard: Sequence[Heard]
    asked: list[Asked]
    said: list[tuple[float, int]]
    stated: list[Stated]
    codes: list[tuple[float, str, int | None]]

    def of(
        self, servo_id: int, quantity: str, first_s: float = 0, last_s: float = 1e9
    ) -> list[int]:
        """Return a servo's numbers of one quantity, of a time."""
        return [
            s.raw
            for s in self.stated
            if (s.servo_id, s.quantity) == (servo_id, quantity) and first_s <= s.t_s < last_s
        ]

    def told(self, first_s: float, last_s: float, *servo_ids: int) -> set[str]:
        """Return the codes of a time, of some servos."""
        return {code for t, code, who in self.codes if first_s <= t <= last_s and who in servo_ids}


@functools.lru_cache(4)
def seen(scenario: Scenario, seed: int) -> Seen:
    """Make a scenario and decode it."""
    heard = scenario.make(seed)
    protocol = PROTOCOLS[scenario.protocol]
    decoder = Decoder(scenario.protocol, baud=scenario.baud)
    it = Seen(heard, [], [], [], [])
    chunks = [Chunk(x.wire, x.t_end_ns, Clock.SAMPLE) for x in heard]
    for b in (decoder.feed(*chunks), decoder.close()):
        f, t, s = b.frames, b.transactions, b.samples
        rows = zip(t.request.tolist(), t.outcome.tolist(), t.response_time_ns.tolist(), strict=True)
        took = {row: ns / NS for row, outcome, ns in rows if outcome == OK}
        for i in range(len(f)):
            who, op = int(f.servo_id[i]), protocol.op_name(int(f.op[i]))
            if f.kind[i] == REQUEST:
                raw = b.data[int(f.start[i]) : int(f.end[i])]
                it.asked.append(Asked(int(f.t_start[i]) / NS, who, op, raw, took.get(i)))
            else:
                it.said.append((int(f.t_end[i]) / NS, who))
        for i in range(len(s)):
            r = protocol.registers[int(s.register[i])]
            t_s, is_whole = int(s.t_ns[i]) / NS, bool(s.part[i] == WHOLE)
            row = Stated(t_s, int(s.servo_id[i]), r.name, r.quantity or "", int(s.raw[i]), is_whole)
            it.stated.append(row)
        it.codes.extend((a.t_ns / NS, a.code, a.servo_id) for a in b.anomalies)
    return it
