"""The sink that diagnoses: it keeps a ledger a bus, and judges what it has when asked."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

from sniffer.decoding.joining import joined, runs
from sniffer.decoding.names import AND
from sniffer.decoding.sink import bus_of
from sniffer.diagnosis.case import Case
from sniffer.diagnosis.incidents import incidents
from sniffer.diagnosis.ledger.ledger import Ledger
from sniffer.diagnosis.ledger.withheld import with_withheld
from sniffer.diagnosis.rest import rest_of
from sniffer.diagnosis.shared import one_way, shared
from sniffer.ground.amounts import lasting
from sniffer.ground.model import NS, Clock
from sniffer.ground.wording import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.decoding.pacing import Pace
    from sniffer.diagnosis.model import Incident
    from sniffer.diagnosis.rest import Rest
    from sniffer.diagnosis.shared import OneWay, Shared
    from sniffer.ground.model import Batch, Chunk
    from sniffer.protocols.base import BusProtocol


TELLING_NS: Final = NS // 5000
"""Digits that a log does not have make its stamps worse by more than that, or are not told."""

QUIET_NS: Final = 5 * NS
"""So much sooner than the others a bus has ended, or its frames than its bytes, that something
ended them; a shutdown takes less."""

TOGETHER: Final = 1 << 16
"""Bytes that go into a ledger at once, unless somebody asks before: a pass over a few frames costs
as much as one over thousands."""


class Diagnosis:
    """Takes what a decode gives and says what is wrong with each bus, and why.

    What it says does not depend on how the stream was cut, nor on how often it was asked before.
    """

    def __init__(self) -> None:
        self._ledgers: dict[str, Ledger] = {}
        self._waiting: dict[str, list[Batch]] = {}
        self._paces: dict[str, Pace] = {}
        self._cases: list[Case] | None = None  # what was asked last, while nothing came since

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take chunks as they came: all that matters of them comes decoded."""

    def pace(self, bus: str, told: Pace) -> None:
        """Take what a bus is timed by."""
        self._paces[bus] = told

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        """Take what one pass decided."""
        self._cases = None
        name = bus_of(bus, protocol, batch)
        ledger = self._ledgers.get(name)
        if ledger is None:
            ledger = self._ledgers[name] = Ledger(bus, protocol)
            ledger.pace = self._paces.get(bus)
        waiting = self._waiting.setdefault(name, [])
        waiting.append(batch)
        if sum(len(b.data) for b in waiting) >= TOGETHER:
            self._take(name)

    def _take(self, name: str) -> None:
        """Let a ledger have what waits for it."""
        for run in runs(self._waiting.pop(name, [])):
            self._ledgers[name].add(joined(run))

    def close(self) -> None:
        """Finish; the diagnosis can be asked for afterwards."""

    def cases(self) -> list[Case]:
        """Return each bus as the rules see it; what they found is known until more is heard."""
        if self._cases is not None:
            return self._cases
        for name in list(self._waiting):
            self._take(name)
        first = {ledger.bus: ledger for ledger in reversed(self._ledgers.values())}
        self._cases = [
            Case(with_withheld(ledger), speaks_first=first[ledger.bus] is ledger)
            for ledger in self._ledgers.values()
        ]
        return self._cases

    def incidents(self) -> tuple[Incident, ...]:
        """Return the incidents of all buses so far, by bus and beginning."""
        found = [incident for case in self.cases() for incident in incidents(case)]
        return tuple(replace(incident, number=n) for n, incident in enumerate(found, 1))

    def spoken(self) -> dict[str, str]:
        """Return what was spoken on each bus of which anything was decoded (``a+b``: two)."""
        out: dict[str, str] = {}
        for ledger in self._ledgers.values():
            name = ledger.protocol.name
            out[ledger.bus] = f"{out[ledger.bus]}{AND}{name}" if ledger.bus in out else name
        return out

    def judged(self) -> list[dict[str, Any]]:
        """Return on what each bus was judged, and how sure its times are."""
        return [
            {
                "bus": case.bus,
                "protocol": case.protocol.name,
                "bytes": case.ledger.bytes,
                "frames": case.ledger.frames,
                "seconds": round(case.seconds, 3) if case.has_clock else None,
                "servo_ids": list(case.servos),
                "clock": Clock(case.ledger.clock).name.lower(),
                "latency_ns": case.latency_ns if case.has_clock else None,
            }
            for case in self.cases()
        ]

    @property
    def has_clock(self) -> bool:
        """Whether the times of all buses are measured."""
        return all(case.has_clock for case in self.cases())

    @property
    def first_ns(self) -> int:
        """When the first bus was first heard."""
        return min((case.first_ns for case in self.cases()), default=0)

    def shared(self, incidents: Sequence[Incident]) -> tuple[Shared, ...]:
        """Return which incidents of several buses are likely one fault each."""
        return shared(incidents, self.cases())

    def one_way(self, incidents: Sequence[Incident]) -> tuple[OneWay, ...]:
        """Return the buses of which one direction is heard."""
        return one_way(incidents, self.cases())

    def rest(self, incidents: Sequence[Incident]) -> Rest:
        """Return the warnings and errors that no incident has, in words, and what to do next."""
        return rest_of(self.cases(), incidents)

    def sentence(self) -> str:
        """Return on what it was judged, in words."""
        parts = []
        cases = self.cases()
        until_ns = max((_heard_until_ns(case) for case in cases if case.has_clock), default=0)
        for judged, case in zip(self.judged(), cases, strict=True):
            if not judged["frames"]:  # of which protocol none holds, none is known to be spoken
                parts.append(f"{judged['bus']}: {counted(judged['bytes'], 'byte')}, in no frame")
                continue
            in_vain = len(_asked_in_vain(case))
            servos = len(judged["servo_ids"]) - in_vain
            good_ns = judged["latency_ns"] or 0
            unsure_ns = case.ledger.exchanges.unsure_ns
            good_ns = unsure_ns if unsure_ns > good_ns + TELLING_NS else good_ns
            over = (
                f"over {judged['seconds']:g} s, stamps good to {lasting(good_ns)}"
                if judged["seconds"] is not None
                # a second of bytes is any time on the wire
                else "without a clock, so nothing was judged by time: "
                "seconds count bytes, no pauses"
            )
            told = counted(servos, "servo")
            if in_vain:
                told += f" ({counted(in_vain, 'id')} asked in vain)"
            parts.append(
                f"{judged['bus']}: {counted(judged['frames'], judged['protocol'] + ' frame')} of "
                f"{told} {over}{_then_torn(case)}{_then_nothing(case, until_ns)}"
            )
        return "; ".join(parts)


def _asked_in_vain(case: Case) -> list[int]:
    """Return the ids that were asked for answers and never gave one, where others did."""
    silent = [i for i in case.servos if i not in case.answering and case.total("missing", i)]
    return silent if case.answering else []


def _then_torn(case: Case) -> str:
    """Say that bytes came for long behind the last frame: the time of frames is not all of it."""
    torn_ns = _heard_until_ns(case) - case.last_ns if case.has_clock else 0
    return f", then bytes of no frame for {torn_ns / NS:.0f} s" if torn_ns >= QUIET_NS else ""


def _then_nothing(case: Case, until_ns: int) -> str:
    """Say that a bus fell silent for good while others go on, and for longer than ever before."""
    silent_ns = until_ns - _heard_until_ns(case) if case.has_clock else 0
    if silent_ns < QUIET_NS or silent_ns < 2 * case.line["pause_max"].max(initial=0):
        return ""
    return f", then nothing for the last {silent_ns / NS:.0f} s, while others go on"


def _heard_until_ns(case: Case) -> int:
    """Return when the last byte came, also one of no frame."""
    return int(case.line["t_last"].max(initial=case.last_ns))
