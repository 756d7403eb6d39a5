"""The benchmark of the diagnosis: its UART, its scenarios, and how it judges what was said."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.diagnosis import crossed, evidence, mixtures, sound, taps, wires
from bench.diagnosis.bodies import Body, Supply
from bench.diagnosis.catalogue import scenarios
from bench.diagnosis.dialects import DIALECTS
from bench.diagnosis.figures import gathered
from bench.diagnosis.hosts import HOSTS, START_NS, Capture, exact
from bench.diagnosis.judging import Case, Told, case_of, score
from bench.diagnosis.line import Bench
from bench.diagnosis.report import GUIDE, MEASURED, RESULTS, STATED, report
from bench.diagnosis.scenario import Heard, Scenario, Truth
from bench.diagnosis.uart import BITS, HIGH, LOW, Burst, Clash, Pulse, Receiver, line
from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.decoding.decoder import Decoder
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.rules import FINDINGS
from sniffer.ground.model import NS, Chunk, MarkKind
from tests.lists import each_in_turn, in_turn

EVERY = each_in_turn(2, "protocol", DIALECTS)
HOST = pytest.mark.parametrize("host", HOSTS)
BIT = NS / 115200


def values(edges: list[tuple[float, int]], baud: int = 115200) -> list[tuple[int, bool]]:
    return [(b.value, b.stop) for b in Receiver(baud).hear(edges)]


@given(
    data=st.binary(min_size=1, max_size=40),
    baud=st.sampled_from((9600, 57600, 115200, 1_000_000)),
    error=st.floats(-0.03, 0.03),
    begin=st.floats(0, 1e9),
    late=st.floats(0, 0.3),
    seed=st.integers(0, 99),
)
def test_what_is_sent_is_heard_by_a_clock_that_is_off_by_less_than_three_percent(
    data: bytes, baud: int, error: float, begin: float, late: float, seed: int
) -> None:
    bit = NS / baud * (1 + error)
    edges = line([Burst(begin, data, bit, lambda number, low: 0.2 * late * bit)])
    heard = Receiver(baud).hear(edges, random.Random(seed))
    assert bytes(b.value for b in heard) == data
    assert all(b.stop for b in heard)
    assert all(abs(b.t_ns - begin - k * BITS * bit) < bit for k, b in enumerate(heard))


@given(one=st.binary(min_size=1, max_size=20), data=st.data())
def test_of_two_who_pull_low_at_once_each_bit_is_low_that_either_pulls(
    one: bytes, data: st.DataObject
) -> None:
    other = data.draw(st.binary(min_size=len(one), max_size=len(one)))
    bursts = [Burst(1000.0, one, BIT), Burst(1000.0, other, BIT)]
    both = [a & b for a, b in zip(one, other, strict=True)]
    either = [a | b for a, b in zip(one, other, strict=True)]
    assert values(line(bursts, clash=Clash.AND)) == [(value, True) for value in both]
    assert values(line(bursts, clash=Clash.OR)) == [(value, True) for value in either]


def test_two_who_say_the_same_at_once_are_heard_as_one() -> None:
    bursts = [Burst(0.0, b"\x12\x34", BIT), Burst(0.2 * BIT, b"\x12\x34", BIT)]
    for clash in Clash:
        assert values(line(bursts, clash=clash, rng=random.Random(1))) == [
            (0x12, True),
            (0x34, True),
        ]


def test_at_twice_the_rate_a_byte_is_other_bytes_and_stop_bits_are_missing() -> None:
    # the start bit of FF is two of the faster bits; 00 is low for eighteen of them
    assert values(line([Burst(0.0, b"\xff", 2 * BIT)])) == [(0xFE, True)]
    assert values(line([Burst(0.0, b"\x00", 2 * BIT)])) == [(0x00, False)]


def test_a_pulse_of_less_than_half_a_bit_is_no_start_bit_and_a_longer_one_is_a_byte() -> None:
    assert values(line([], [Pulse(0.0, 0.4 * BIT, LOW)])) == []
    assert values(line([], [Pulse(0.0, 0.9 * BIT, LOW)])) == [(0xFF, True)]
    assert values(line([], [Pulse(0.0, 4.9 * BIT, LOW)])) == [(0xF0, True)]


def test_a_line_that_is_held_low_is_one_byte_of_00_without_a_stop_bit() -> None:
    assert values(line([], [Pulse(0.0, 5000 * BIT, LOW)])) == [(0x00, False)]


def test_a_line_that_is_held_high_swallows_what_is_said_meanwhile() -> None:
    burst = Burst(0.0, b"\x55\x55", BIT)
    assert values(line([burst], [Pulse(-1.0, BITS * BIT, HIGH)])) == [(0x55, True)]


def test_a_sender_that_is_cut_off_is_not_heard() -> None:
    burst = Burst(0.0, b"\x00\x41", BIT, muted=((-1.0, BITS * BIT),))
    assert values(line([burst])) == [(0x41, True)]


@pytest.mark.parametrize("protocol", ["mightyzap", "rs30x"])
def test_sixteen_sound_servos_that_start_at_once_are_left_what_they_work_with(
    protocol: str,
) -> None:
    dialect = DIALECTS[protocol]
    for seed in range(20):
        bench = Bench(protocol, seed, dialect.ids[:16], 115200)
        supply = bench.bodies[dialect.ids[0]].supply
        supply.total_a = 0.6 * len(bench.bodies)  # half of what they take when they are held fast
        assert supply.voltage > 0.75 * dialect.volt


@EVERY
def test_what_a_dialect_says_is_understood_by_the_decoder(protocol: str) -> None:
    dialect, rng = DIALECTS[protocol], random.Random(1)
    body = Body(dialect.ids[3], rng, Supply(dialect.volt, 0.1))
    dialect.fit(body, rng)
    who = body.servo_id
    asked = [dialect.ping(who), dialect.state(who), dialect.position(who), dialect.health(who)]
    asked += [dialect.move(body, 0.6), *dialect.move_all({who: 0.4})]
    asked += [dialect.switch_off(body), dialect.switch_on(body)]
    said, count = b"", 0
    for request in asked:
        body.look(count * 10_000_000)
        assert dialect.whom(request.data) in (who, None)
        answer = dialect.answer(body, request.data)
        assert bool(answer) == bool(request.patience_ns)
        count += 1 + bool(answer)
        said += request.data + answer
    decoder = Decoder(protocol)
    batches = [decoder.feed(Chunk(said)), decoder.close()]
    assert sum(len(b.frames) for b in batches) == count
    assert not [gap for b in batches for gap in b.gaps]
    assert not [a for b in batches for a in b.anomalies]


def some_scenarios() -> list[Scenario]:
    """Return of each kind one protocol's, in turn."""
    out = []
    for module in (wires, crossed, taps, mixtures, sound):
        every = list(module.scenarios(3))
        count = len(every) // len(DIALECTS)
        out += [every[k % len(DIALECTS) * count + k % count] for k in range(count)]
    return out


@each_in_turn(8, "scenario", some_scenarios(), ids=lambda s: s.name)
def test_a_scenario_is_traffic_in_order_and_the_same_for_the_same_seed(scenario: Scenario) -> None:
    heard = scenario.make(5)
    assert sum(len(h.wire) for h in heard) > 100
    for h in heard:
        assert h.t_start_ns <= h.t_end_ns
        assert all(0 <= k < len(h.wire) for k in h.line_errors)
    ends = [h.t_end_ns for h in heard]
    assert ends == sorted(ends)
    for truth in scenario.truths:
        assert 0 <= truth.first_s < truth.last_s
    assert list(scenario.make(5)) == list(heard)


def test_every_scenario_has_a_name_of_its_own_and_there_are_many() -> None:
    names = [s.name for s in scenarios(0)]
    assert len(names) == len(set(names))
    assert len([s for s in scenarios(0) if s.truths]) >= 60
    assert {s.protocol for s in scenarios(0)} == set(DIALECTS)


@in_turn(5)
@pytest.mark.parametrize("name", ["poll-each", "bursts", "full-load", "pauses", "person"])
@EVERY
def test_sound_traffic_decodes_without_a_word(name: str, protocol: str) -> None:
    it = sound.of(name, protocol)
    capture = exact(it, it.make(2), 2)
    decoder = Decoder(protocol, baud=it.baud)
    batches = [decoder.feed(*capture.chunks), decoder.close()]
    assert not [a for b in batches for a in b.anomalies if a.code != "capture-end"]
    assert sum(len(b.frames) for b in batches) > 20


@HOST
def test_a_host_hands_on_every_byte_and_knows_when_things_were(host: str) -> None:
    it = sound.of("poll-each", "rs30x")
    heard = it.make(1)
    capture = HOSTS[host](it, heard, 1)
    assert b"".join(c.data for c in capture.chunks) == b"".join(h.wire for h in heard)
    assert capture.moments(0.0) <= capture.moments(1.0) < capture.moments(5.0)
    stamps = [c.t_ns for c in capture.chunks if c.t_ns is not None]
    assert stamps == sorted(stamps)
    assert bool(stamps) == (host != "raw")


def test_a_missing_stop_bit_is_marked_at_its_byte_or_for_the_whole_packet() -> None:
    it = Scenario("x", "lss", (), 115200, lambda seed: ())
    heard = [
        Heard(0, 1_000_000, b"#1QD\r", True, (1,)),
        Heard(1_300_000, 1_400_000, b"\0", False, (0,)),
    ]
    marks = [m for c in HOSTS["exact"](it, heard, 1).chunks for m in c.marks]
    assert [(m.kind, m.start, m.length) for m in marks] == [
        (MarkKind.FRAMING, 1, 1),
        (MarkKind.BREAK, 0, 1),
    ]
    (packet,) = HOSTS["usb16"](it, heard, 1).chunks
    assert {(m.kind, m.start, m.length) for m in packet.marks} == {
        (MarkKind.FRAMING, 0, 6),
        (MarkKind.BREAK, 0, 6),
    }


def told(
    *causes: tuple[str, float],
    servos: tuple[int, ...] = (),
    span: tuple[float, float] = (0, 10),
    severity: str = "error",
    codes: tuple[str, ...] = (),
) -> Told:
    first, last = (START_NS + round(s * NS) for s in span)
    return Told(severity, servos, first, last, causes, codes)


def case(truths: tuple[Truth, ...], *said: Told, frames: int = 1000) -> Case:
    spans = tuple(
        (START_NS + round(t.first_s * NS), START_NS + round(t.last_s * NS)) for t in truths
    )
    return Case("made-up", "rs30x", "exact", 0, truths, spans, said, frames)


CABLE = Truth("bad-cable", (3,), 4, 8)
NOISE = Truth("bus-noise", (), 0, 10, ("damage-everywhere",))


def test_a_fault_is_named_where_cause_and_time_agree_and_its_servo_where_that_does() -> None:
    right = told(("bad-cable", 0.9), servos=(3,), span=(5, 6))
    other = told(("bad-cable", 0.9), servos=(4,), span=(5, 6))
    before = told(("bad-cable", 0.9), servos=(3,), span=(1, 2))
    assert score(case((CABLE,), right)).held[0].right_servo
    held = score(case((CABLE,), other)).held[0]
    assert held.named
    assert not held.right_servo
    assert not score(case((CABLE,), before)).held[0].named


def test_a_cause_in_the_second_place_is_listed_and_not_named() -> None:
    second = told(("bus-noise", 0.6), ("bad-cable", 0.3), servos=(3,), span=(5, 6))
    it = score(case((CABLE,), second))
    assert (it.held[0].named, it.held[0].listed) == (False, True)
    assert it.wrong == (second,)
    figures = gathered([it])
    assert figures.confusions() == [(("bad-cable", "bus-noise"), 1)]
    assert (figures.named(), figures.listed()) == (0, 1)


def test_what_a_host_cannot_show_is_no_miss() -> None:
    truth = Truth("controller-jitter", (), 0, 10)
    bare = Case("made-up", "lss", "raw", 0, (truth,), ((0, 10),), (), 100)
    it = score(bare)
    assert it.held[0].excused
    assert gathered([it]).held() == []


def test_what_is_expected_is_known_to_the_diagnosis() -> None:
    codes = {code for known in evidence.FINDINGS.values() for code in known}
    assert codes <= {*FINDINGS, *CATALOGUE}
    truths = [t for s in scenarios(0) for t in s.truths]
    assert {code for t in truths for code in t.findings} <= {*FINDINGS, *CATALOGUE}
    named = {cause for cause, _ in evidence.FINDINGS} | {c for _, c in evidence.UNSHOWN}
    assert {t.cause for t in truths} | named <= set(CAUSES)


def test_what_the_driver_said_is_not_expected_of_a_text() -> None:
    truth = Truth("tap-loss", (), 0, 10)
    assert evidence.findings(truth, "tap-loss-told-lss", "exact") == ("bytes-lost",)
    assert evidence.findings(truth, "tap-loss-told-lss", "log") == ()
    assert evidence.findings(truth, "tap-loss-lss", "exact") == ()


def test_a_diagnosis_that_raises_is_told_and_ends_nothing() -> None:
    def raises(capture: Capture) -> tuple[tuple[Told, ...], int]:
        raise IndexError("a row too many")

    it = sound.of("poll-each", "lss")
    failed = case_of(it, it.make(1), "raw", 1, diagnose=raises)
    page = report(gathered([score(failed)]))
    assert "IndexError: a row too many" in page.partition("## Every error (1)")[2]


def test_alarms_about_sound_traffic_are_false_and_notes_are_not() -> None:
    note = told(("bus-saturated", 0.6), severity="note")
    alarm = told(("bus-noise", 0.6))
    figures = gathered([score(case((), note, alarm, frames=500)), score(case((), frames=1500))])
    assert figures.false_alarms("exact") == (1, 2000)
    assert [t for _, t in figures.extras()] == [alarm]


def test_the_figures_of_a_few_made_up_cases() -> None:
    noise = told(("bus-noise", 0.8), codes=("damage-everywhere", "noise"))
    cable = told(("bad-cable", 0.6), servos=(3,), span=(5, 6), codes=("no-response",))
    ghost = told(("brownout", 0.4), servos=(9,), span=(5, 6), codes=("voltage-sag",))
    both = score(case((CABLE, NOISE), noise, cable, ghost))
    missed = score(case((CABLE,)))
    figures = gathered([both, missed])
    assert figures.named() == pytest.approx(2 / 3)
    assert (figures.right_servo(), figures.nobody()) == (1, 1)
    assert figures.incidents_a_fault() == 1
    assert figures.brier() == pytest.approx((0.2**2 + 0.4**2 + 0.4**2) / 3)
    rows = {cause: (len(held), said, right) for cause, held, said, right in figures.causes()}
    assert rows == {"bad-cable": (2, 1, 1), "brownout": (0, 1, 0), "bus-noise": (1, 1, 1)}
    assert ("damage-everywhere", 1, 0, 1, 1) in list(figures.findings())
    assert ("voltage-sag", 0, 1, 0, 0) in list(figures.findings())
    assert [h.case for h in figures.misses()] == [missed.case]
    page = report(figures)
    assert "| right first cause | 66.7 % |" in page
    assert "made-up" in page.partition("## Every miss (1)")[2]


@HOST
def test_a_case_holds_what_the_diagnosis_said_of_a_capture(host: str) -> None:
    it = next(s for s in taps.scenarios(0) if s.name == "tap-one-way-requests-rs30x")
    seen = case_of(it, it.make(1), host, 1)
    assert seen.frames > 100
    assert score(seen).held[0].named


def test_the_guide_states_of_sure_causes_what_was_measured() -> None:
    measured = MEASURED.search(RESULTS.read_text(encoding="utf-8"))
    assert measured is not None
    assert STATED.findall(GUIDE.read_text(encoding="utf-8")) == [measured[1]]


def test_of_sure_causes_those_that_are_right_are_counted() -> None:
    def told(cause: str, sure: float) -> Told:
        return Told("warn", (1,), START_NS, START_NS + NS, ((cause, sure),), ())

    truth = Truth("stall", (1,), 0.0, 1.0)
    span = (START_NS, START_NS + NS)
    cases = [
        Case("x", "wck", "exact", n, (truth,), (span,), (told(cause, sure),), 100)
        for n, (cause, sure) in enumerate((("stall", 0.9), ("stall", 0.85), ("overload", 0.8)))
    ]
    cases.append(Case("x", "wck", "exact", 9, (truth,), (span,), (told("overload", 0.6),), 100))
    assert gathered(map(score, cases)).right_of_sure() == pytest.approx(2 / 3)
