"""What the stamps of a log tell: its rate, how long its host held bytes, what they cannot tell."""

from __future__ import annotations

import functools
import itertools
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import pytest

from sniffer import diagnose
from sniffer.decoding.decoder import Decoder
from sniffer.decoding.durations import Bounds, Quantiles
from sniffer.decoding.joining import joined
from sniffer.decoding.pacing import (
    ASSUMED,
    AT_LEAST,
    ESTIMATED,
    PACKET,
    STATED,
    TIMER_NS,
    Pace,
    exchanges_in,
    pace,
)
from sniffer.decoding.pipeline import Options, Pipeline
from sniffer.ground.codes import OK
from sniffer.ground.model import NS, Chunk, Clock
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import faults as f
from sniffer.simulation.buses import BUSES, simulate
from sniffer.simulation.faults import Fault
from sniffer.simulation.render import frame_reads, usb_reads
from sniffer.sources import open_source
from tests.commands import sniffer
from tests.conversations import Conversation, robot, through_usb
from tests.hosts import MS, lines, reads, truths
from tests.lists import each_in_turn, in_turn
from tests.streams import rs30x
from tests.streams.mightyzap import packet

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.ground.model import Batch
    from sniffer.protocols.base import BusProtocol
    from sniffer.simulation.talk import TrueFrame

CAPTURES: Final = Path(__file__).parents[1] / "sample_captures"
START_NS = 1_700_000_000 * NS
EVERY = each_in_turn(2, "name", BUSES)


class Judged:
    """A log decoded as ``decode`` does, beside the truth."""

    def __init__(
        self, name: str, truth: Sequence[TrueFrame], chunks: Iterable[Chunk], **options: int
    ) -> None:
        self.codes: Counter[str] = Counter()
        self.count = self.outside = 0
        self._true = truths(truth)
        pipeline = Pipeline(Options(name, **options), [self])  # type: ignore[arg-type]
        pipeline.feed(chunks)
        pipeline.close()
        self.pace: Pace = pipeline.paces["bus0"]
        self.summary = pipeline.summary

    def raw(self, bus: str, chunks: Sequence[Chunk]) -> None:
        """Take nothing."""

    def write(self, bus: str, protocol: BusProtocol, batch: Batch) -> None:
        self.codes.update(a.code for a in batch.anomalies)
        t = batch.transactions
        for response, outcome, took, unsure in zip(
            t.response.tolist(),
            t.outcome.tolist(),
            t.response_time_ns.tolist(),
            t.uncertainty_ns.tolist(),
            strict=True,
        ):
            at = batch.base + int(batch.frames.start[response])
            if outcome == OK and at in self._true:
                self.count += 1
                # times on the line are whole nanoseconds a byte
                self.outside += abs(took - self._true[at]) > unsure + 100

    def close(self) -> None:
        """Do nothing."""


@functools.cache
def bus(
    name: str, seconds: float = 8, *, baud: int | None = None, rate_hz: int | None = None
) -> Sequence[TrueFrame]:
    return tuple(
        simulate(name, seed=1, start_ns=START_NS, duration_s=seconds, baud=baud, rate_hz=rate_hz)
    )


def stamped(told: Iterable[tuple[int, bytes]]) -> list[Chunk]:
    return [Chunk(data, t, Clock.FILE) for t, data in told]


@in_turn(2)
@EVERY
@pytest.mark.parametrize("form", [reads, lines, usb_reads])
@pytest.mark.parametrize("stated", [True, False])
def test_behind_a_16_ms_host_the_truth_is_within_what_is_stated_and_nobody_is_late(
    name: str, form: object, stated: bool
) -> None:
    truth, baud = bus(name), BUSES[name].baud
    if form is usb_reads:
        log = stamped(usb_reads(truth, baud, latency_ns=16 * MS))
    else:
        log = (reads if form is reads else lines)(truth, baud, seed=3)
    judged = Judged(name, truth, log, **({"baud": baud} if stated else {}))
    assert judged.count > 100
    assert judged.outside <= judged.count // 100
    assert judged.codes["late-response"] == 0
    if form is not usb_reads:
        assert judged.pace.latency == ESTIMATED
        assert 16 * MS <= (judged.pace.latency_ns or 0) <= 25 * MS


@EVERY
def test_the_frames_and_exchanges_that_are_looked_at_are_those_of_the_decoder(name: str) -> None:
    source = open_source(CAPTURES / f"{name}_damaged.log")
    data = b"".join(chunk.data for group in source for chunk in group)
    frames, asked, answered = exchanges_in(PROTOCOLS[name], data)
    decoder = Decoder(name)
    whole = joined([decoder.feed(data), decoder.close()])
    t = whole.transactions
    fits = (t.outcome == OK) & (t.request >= 0) & (t.response >= 0)
    assert frames.start.tolist() == whole.frames.start.tolist()
    assert frames.end.tolist() == whole.frames.end.tolist()
    pairs = zip(t.request[fits].tolist(), t.response[fits].tolist(), strict=True)
    found = sorted(zip(asked.tolist(), answered.tolist(), strict=True))
    assert found == sorted(pairs)
    assert len(found) > 100


@EVERY
def test_a_prompt_host_is_not_said_to_hold_anything(name: str) -> None:
    truth, baud = bus(name), BUSES[name].baud
    for told in (frame_reads(truth), usb_reads(truth, baud)):
        judged = Judged(name, truth, stamped(told))
        assert judged.pace.latency_ns is None
        assert not judged.pace.remarks
        assert judged.outside == 0


@EVERY
def test_a_servo_that_is_late_is_late_in_a_prompt_log_whose_rate_nobody_stated(name: str) -> None:
    faults = (Fault(f.LATE, 0.05),)
    truth = list(simulate(name, seed=5, start_ns=START_NS, duration_s=8, faults=faults))
    told = Judged(name, truth, stamped(frame_reads(truth)), baud=BUSES[name].baud)
    assumed = Judged(name, truth, stamped(frame_reads(truth)))
    assert assumed.codes["late-response"] == told.codes["late-response"] > 0


def test_the_latency_that_the_user_states_wins() -> None:
    truth = bus("mightyzap")
    judged = Judged("mightyzap", truth, reads(truth, 57600), latency_ns=5 * MS)
    assert (judged.pace.latency_ns, judged.pace.latency) == (5 * MS, STATED)


@EVERY
@pytest.mark.parametrize("form", ["frames", "usb"])
def test_a_9600_log_whose_rate_nobody_stated_accuses_no_servo(name: str, form: str) -> None:
    truth = bus(name, 20, baud=9600)
    log = stamped(frame_reads(truth) if form == "frames" else usb_reads(truth, 9600))
    stated, assumed = (Judged(name, truth, log, **o) for o in ({"baud": 9600}, {}))
    assert assumed.codes == stated.codes
    assert assumed.outside <= assumed.count // 100
    assert assumed.pace.slowest == 9600
    if form == "usb":
        assert (assumed.pace.rate, assumed.pace.baud) == (ESTIMATED, 9600)
        usual = BUSES[name].baud == 9600
        assert ("by its stamps the line runs at 9600 baud" in str(assumed.pace.remarks)) != usual


def test_a_rate_that_answers_of_two_lengths_tell_is_estimated() -> None:
    truth = bus("rs30x", 8, baud=9600)
    judged = Judged("rs30x", truth, stamped(frame_reads(truth)))
    assert (judged.pace.rate, judged.pace.baud) == (ESTIMATED, 9600)


def test_a_log_faster_than_the_usual_rate_is_not_timed_by_it() -> None:
    truth = bus("mightyzap", 8, baud=400_000, rate_hz=400)
    judged = Judged("mightyzap", truth, stamped(frame_reads(truth)))
    assert judged.pace.baud > 57600
    assert judged.pace.rate == ESTIMATED
    assert judged.outside == 0


def test_a_rate_that_cannot_be_is_called_that() -> None:
    truth = bus("rs30x", 8)
    judged = Judged("rs30x", truth, stamped(frame_reads(truth)), baud=9600)
    assert judged.pace.faster > 2
    assert "9600 baud (stated) cannot be" in judged.pace.remarks[0]
    assert not Judged("rs30x", truth, stamped(frame_reads(truth)), baud=115200).pace.remarks


def test_few_lines_tell_nothing_and_the_usual_is_assumed() -> None:
    truth = bus("mightyzap", 0.02)
    judged = Judged("mightyzap", truth, stamped(frame_reads(truth)))
    assert (judged.pace.rate, judged.pace.baud, judged.pace.latency_ns) == (ASSUMED, 57600, None)


def test_decoding_a_log_says_what_was_inferred_of_its_host(tmp_path: Path) -> None:
    truth = bus("lss", 4)
    log = tmp_path / "lss.log"
    log.write_text(
        "".join(
            f"({(k.t_ns or 0) // NS}.{(k.t_ns or 0) % NS:09d}) bus0 000#{k.data.hex().upper()}\n"
            for k in reads(truth, BUSES["lss"].baud)
        )
    )
    ran = sniffer("decode", log, "--protocol", "lss", "--summary")
    assert ran.status == 0
    assert "the host seems to have held bytes for up to" in ran.err
    assert "assumed to run at 115200 baud" in ran.out
    whole = sniffer("decode", log, "--protocol", "lss", "--format", "jsonl")
    again = sniffer("decode", log, "--protocol", "lss", "--quiet", "-o", tmp_path / "lss.mcap")
    assert again.status == 0
    redecoded = sniffer("decode", tmp_path / "lss.mcap", "--protocol", "lss", "--format", "jsonl")
    assert redecoded.out == whole.out


def test_a_log_of_hundredths_of_seconds_shows_that_its_adapter_holds_bytes(tmp_path: Path) -> None:
    """What took longer than a prompt host waits came in one: no servo is slow for where it ends."""
    talk = robot("rs30x", 20, servos=(1, 2, 3, 4, 5), rate_hz=17.24, goals=False)
    log: list[tuple[int, bytes]] = []
    due_ns, held = (talk.chunks[0].t_ns or 0) + TIMER_NS, bytearray()
    for chunk in talk.chunks:
        t_ns = chunk.t_ns or 0
        if t_ns >= due_ns:
            log.append((due_ns, bytes(held)))
            held.clear()
            due_ns += ((t_ns - due_ns) // TIMER_NS + 1) * TIMER_NS
        held += chunk.data
        if len(held) >= PACKET:
            log.append((t_ns, bytes(held[:PACKET])))
            del held[:PACKET]
            due_ns = t_ns + TIMER_NS
    path = tmp_path / "arm.log"
    path.write_text("".join(f"({t / NS:.2f}) bus0 #{data.hex()}\n" for t, data in log if data))
    judged = diagnose(path)
    assert not judged.incidents
    assert "29 ms" in judged.sentence


# --- figures -------------------------------------------------------------------------------------


def test_every_quantile_has_bounds_that_hold_the_truth_and_do_not_cross() -> None:
    truth = bus("mightyzap", 20)
    judged = Judged("mightyzap", truth, reads(truth, 57600))
    true = sorted(truths(truth).values())
    for q in judged.summary.buses["bus0"].times.values():
        found = [q.at(share) for share in (0.1, 0.5, 0.9, 0.99, 1.0)]
        bounds = [b for b in found if b is not None]
        assert len(bounds) == 5
        for one, next_one in itertools.pairwise(bounds):
            assert one.low <= next_one.low
            assert one.high <= next_one.high
        assert bounds[-1].low <= true[-1] <= bounds[-1].high
        assert bounds[1].low <= true[len(true) // 2] <= bounds[1].high


def test_a_figure_that_the_stamps_do_not_carry_is_no_number() -> None:
    import numpy as np

    unsure, exact = Quantiles(), Quantiles()
    unsure.add(np.array([0, 0, 31_000]), np.array([298_000_000] * 3))
    exact.add(np.array([500_000] * 3), np.array([1000] * 3))
    assert [unsure.at(s).point for s in (0.5, 0.99, 1.0)] == [None] * 3  # type: ignore[union-attr]
    point = exact.at(0.5)
    assert point is not None
    assert point.point == pytest.approx(500_000, rel=0.05)
    assert point.low <= 500_000 <= point.high
    assert Bounds(0, 2_000_000).ms() == "<2.00"
    assert Bounds(9_000_000, 12_000_000).ms() == "9.00-12.00"
    assert Bounds(9_900_000, 10_100_000).ms() == "10.00"
    assert Bounds(348_100_000, 363_500_000).ms() == "356", "no digits that nobody knows"
    assert Bounds(355_820_000, 355_830_000).ms() == "355.82"


def test_a_servo_that_acknowledges_at_once_is_no_sign_of_a_host_that_holds_bytes() -> None:
    """Question and a byte as answer are closer than pieces of one read, and no timer cuts them."""
    talk = Conversation("rs30x")
    for k in range(400):
        talk.until(k * 0.02)
        talk.say(rs30x.write(1, 0x1E, bytes([k % 200, 0, 8, 0]), flags=1))
        talk.rest(0.1)
        talk.say(b"\x07")
    prompt = [replace(chunk, clock=Clock.FILE) for chunk in talk.chunks]
    assert pace(PROTOCOLS["rs30x"], prompt, baud=talk.baud).latency_ns is None
    held = [replace(chunk, clock=Clock.FILE) for chunk in through_usb(talk.chunks)]
    assert pace(PROTOCOLS["rs30x"], held, baud=talk.baud).latency == ESTIMATED


def _over_a_network(baud: int, stall_s: float = 0.0, seconds: int = 6) -> list[Chunk]:
    """A line that is asked without a pause, as a server on the network hands it on each 10 ms."""
    told: dict[int, bytes] = {}
    t = 0.0
    while t < seconds:
        for data in (packet(1, 0xF2, b"\x8c\x08"), packet(1, 0x00, bytes(8))):
            t += len(data) * 10 / baud + 100e-6
            due = max(t, 2 + stall_s) if 2 <= t < 2 + stall_s else t
            slot = int(due * 100) + 1
            told[slot] = told.get(slot, b"") + data
    return [Chunk(data, START_NS + k * 10 * MS, Clock.READ) for k, data in told.items()]


@pytest.mark.parametrize(
    ("baud", "stall_s", "rate", "timed"),
    [
        (57600, 0.0, ASSUMED, 57600),
        (57600, 0.7, ASSUMED, 57600),
        (400_000, 0.0, AT_LEAST, 400_000),
        (400_000, 0.7, AT_LEAST, 400_000),
    ],
)
def test_what_an_address_hands_on_faster_than_the_usual_rate_is_not_timed_by_it(
    baud: int, stall_s: float, rate: str, timed: int
) -> None:
    """4 s were 24 s, at a load of 560 %; nobody knows the rate of a line behind an address."""
    found = pace(PROTOCOLS["mightyzap"], _over_a_network(baud, stall_s))
    assert (found.rate, found.baud, found.faster) == (rate, timed, 0.0)
    assert bool(found.remarks) == (rate == AT_LEAST)
    stated = pace(PROTOCOLS["mightyzap"], _over_a_network(baud, stall_s), baud=57600)
    assert (stated.baud, stated.remarks) == (57600, ())


def test_what_comes_faster_than_any_rate_over_a_network_is_told() -> None:
    found = pace(PROTOCOLS["mightyzap"], _over_a_network(4_000_000, seconds=3))
    assert found.baud == 57600
    assert "57600 baud (assumed) cannot be: by their stamps" in found.remarks[0]
