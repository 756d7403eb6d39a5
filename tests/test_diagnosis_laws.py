"""Laws of the diagnosis: it depends on what was said, not on how it was handed over."""

from __future__ import annotations

import functools
from typing import Any

from hypothesis import given, settings
from hypothesis import strategies as st

from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.diagnosis import Diagnosis
from sniffer.diagnosis.case import Case
from sniffer.diagnosis.ledger.ledger import ASKED
from sniffer.ground.model import Chunk, Clock
from sniffer.simulation.buses import BUSES, simulate
from sniffer.simulation.faults import FAULTS, Fault
from tests.conversations import T0
from tests.diagnosed import chunks_of, diagnosed, found
from tests.lists import each_in_turn
from tests.streams.mightyzap import packet


@functools.cache
def bus(protocol: str, seed: int, seconds: float = 1.5, rate: float = 0.02) -> list[Chunk]:
    kinds = [kind for kind in FAULTS if kind not in BUSES[protocol].unknown_faults]
    faults = [Fault(kind, rate) for kind in kinds]
    return chunks_of(simulate(protocol, seed=seed, faults=faults, duration_s=seconds))


def told(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    return [incident.as_dict() for incident in diagnosis.incidents()]


def tables(diagnosis: Diagnosis) -> list[dict[str, Any]]:
    """Return all that a ledger remembers, as plain lists."""
    out: list[dict[str, Any]] = []
    for case in diagnosis.cases():
        for name in (
            "traffic",
            "answers",
            "line",
            "alarms",
            "writes",
            "damage",
            "_values",
            "orders",
        ):
            table = getattr(Case(case.ledger), name)
            out.append({name: {key: column.tolist() for key, column in table.items()}})
        out.append({"refusals": {k: c.tolist() for k, c in case.ledger.refusals.counted().items()}})
        places = [(s, k) for s in case.servos for k in range(len(case.protocol.registers))]
        out.append({"steps": [list(case.ledger.steps.of(*place)) for place in places]})
        out.append({"damages": list(case.damages), "unsure": case.ledger.exchanges.unsure_ns})
        rows = case.happenings
        out.append({"events": [getattr(rows, n).tolist() for n in ("kind", "what", "t_ns", "at")]})
    return out


@each_in_turn(4, "protocol", BUSES)
@settings(max_examples=8)
@given(seed=st.integers(0, 5), group=st.integers(5, 300))
def test_what_is_remembered_does_not_depend_on_how_chunks_are_grouped(
    protocol: str, seed: int, group: int
) -> None:
    chunks = bus(protocol, seed)
    whole = diagnosed(chunks, protocol, group=len(chunks))
    cut = diagnosed(chunks, protocol, group=group)
    for one, other in zip(tables(whole), tables(cut), strict=True):
        assert one == other
    assert told(whole) == told(cut)


def test_a_scan_of_thousands_of_registers_stops_no_clock_of_what_is_asked_always() -> None:
    asked = packet(1, 0xF2, b"\x8c\x02") + packet(1, 0, b"\x00\x08")
    scan = [packet(k // 32 + 2, 0xF2, bytes([k % 32, 1])) for k in range(ASKED + 100)]
    said = [*[asked] * 20, b"".join(scan), *[asked] * 80]
    chunks = [Chunk(data, T0 + k * 10**7, Clock.SAMPLE) for k, data in enumerate(said)]
    diagnosis = Diagnosis()
    pipeline = Pipeline(Options(protocol="mightyzap"), [diagnosis], ahead=chunks)
    for chunk in chunks:
        pipeline.feed([chunk])
        diagnosis.cases()  # what waits is remembered, a request at a time
    pipeline.close()
    (case,) = diagnosis.cases()
    periods = case.ledger.periods
    assert periods.count(periods.keys[0]) == 99
    slowest = periods.at(periods.keys[0], 1.0)
    assert slowest is not None
    assert slowest.high < 25 * 10**6


@each_in_turn(2, "protocol", BUSES)
def test_asking_meanwhile_changes_nothing(protocol: str) -> None:
    chunks = bus(protocol, 3)
    diagnosis = Diagnosis()
    pipeline = Pipeline(Options(protocol=protocol), [diagnosis], ahead=chunks)
    for k in range(0, len(chunks), 50):
        pipeline.feed(chunks[k : k + 50])
        diagnosis.incidents()
    pipeline.close()
    pipeline.finish()
    assert told(diagnosis) == told(diagnosed(chunks, protocol))


def test_what_was_found_is_kept_until_more_is_heard() -> None:
    chunks = bus("wck", 3)
    diagnosis = Diagnosis()
    pipeline = Pipeline(Options(protocol="wck"), [diagnosis], ahead=chunks)
    half = len(chunks) // 2
    pipeline.feed(chunks[:half])
    (before,) = diagnosis.cases()
    told(diagnosis)
    assert diagnosis.cases()[0] is before
    pipeline.feed(chunks[half:])
    assert diagnosis.cases()[0] is not before


@each_in_turn(2, "protocol", BUSES)
def test_sound_traffic_has_no_incident(protocol: str) -> None:
    for seed in range(3):
        chunks = chunks_of(simulate(protocol, seed=seed, duration_s=3.0))
        diagnosis = diagnosed(chunks, protocol)
        assert not diagnosis.incidents(), [f.what for f in found(diagnosis)]
