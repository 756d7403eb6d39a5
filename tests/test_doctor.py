"""What the doctor says about a port, from reads as good and bad adapters deliver them."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, Final

import pytest

from sniffer.doctor import (
    Level,
    Listened,
    Observation,
    Trial,
    diagnose,
    understand,
    usual_bauds,
    worst,
)
from sniffer.ground.model import NS, Chunk, Clock, Mark, MarkKind
from sniffer.ground.naming import worded
from sniffer.ports import Counters
from sniffer.ports.listing import PortInfo
from sniffer.protocols import PROTOCOLS
from sniffer.simulation import simulate
from tests.lists import in_turn

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

MS: Final = 1_000_000
EVERY = pytest.mark.parametrize("name", PROTOCOLS)

FACTS: Final = {
    "locked": "yes",
    "also_open_in": "none",
    "echo_at_open": "off",
    "sent_since_plugged": "0",
    "line_errors": "marked, for each packet of the adapter; counted",
    "modem": "low",
    "modem_after_open": "DTR RTS",
    "modem_after_lowering": "all low",
    "latency_timer_ms": "1",
}
FTDI: Final = PortInfo(
    "/dev/ttyUSB0",
    "ftdi_sio",
    "FT232R",
    0x0403,
    0x6001,
    "FTDI",
    "FT232R USB UART",
    "A6008isP",
    "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A6008isP-if00-port0",
    1,
)


@cache
def delivered(name: str, *, every_ns: int, seconds: float = 2.0) -> Sequence[Chunk]:
    """Return what a simulated bus says as an adapter delivers it that is asked so often."""
    out: list[Chunk] = []
    for frame in simulate(name, seed=1, duration_s=seconds):
        if frame.wire:
            t_ns = (frame.t_end_ns // every_ns + 1) * every_ns
            if out and out[-1].t_ns == t_ns:
                out[-1] = replace(out[-1], data=out[-1].data + frame.wire)
            else:
                out.append(Chunk(frame.wire, t_ns, Clock.READ))
    return out


def heard(name: str = "mightyzap", *, every_ns: int = MS) -> Listened:
    """Return a bus heard through an FTDI adapter with which nothing is wrong."""
    return Listened(
        "/dev/ttyUSB0",
        delivered(name, every_ns=every_ns),
        2.0,
        PROTOCOLS[name].baud,
        marks_errors=True,
        risen=Counters(),
        latency_ns=every_ns + MS,
        facts=FACTS,
        info=replace(FTDI, stable=""),
    )


def said(about: str, case: Listened) -> Observation:
    (verdict,) = (v for v in diagnose(case) if v.about == about)
    return verdict


# --- a line as it is seen at another baud --------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Line:
    """When a line is low, in ns: sorted stretches."""

    begin: list[float]
    end: list[float]

    def is_low(self, t: float) -> bool:
        at = bisect.bisect_right(self.begin, t) - 1
        return at >= 0 and t < self.end[at]


@cache
def spoken(name: str, seconds: float) -> Line:
    """Put a simulated bus on a line, bit by bit."""
    bit = NS / PROTOCOLS[name].baud
    line = Line([], [])
    for frame in simulate(name, seed=1, duration_s=seconds):
        for nth, byte in enumerate(frame.wire):
            bits = (0, *(byte >> i & 1 for i in range(8)))
            for place, value in enumerate(bits, 10 * nth):
                if not value:
                    line.begin.append(frame.t_start_ns + place * bit)
                    line.end.append(frame.t_start_ns + (place + 1) * bit)
    return line


def read_at(line: Line, baud: int) -> tuple[list[Chunk], int]:
    """Return what a UART makes of the line, and how many stop bits it missed."""
    bit, t, errors = NS / baud, -1.0, 0
    out: list[Chunk] = []
    while (edge := bisect.bisect_right(line.begin, t)) < len(line.begin):
        start = line.begin[edge]
        t = start + bit / 2
        if line.is_low(t):
            byte = sum((not line.is_low(start + (i + 1.5) * bit)) << i for i in range(8))
            t = start + 9.5 * bit
            errors += line.is_low(t)
            out.append(Chunk(bytes([byte]), round(t), Clock.READ))
    return out, errors


def misheard(name: str, baud: int, *, told: bool = True) -> Listened:
    """Return a bus that is listened to at a baud."""
    chunks, errors = read_at(spoken(name, 1.0), baud)
    case = replace(heard(name), chunks=chunks, baud=baud, seconds=1.0)
    return replace(case, risen=Counters(frame=errors)) if told else replace(case, risen=None)


def test_the_line_of_these_tests_is_read_as_it_was_written() -> None:
    frames = list(simulate("wck", seed=1, duration_s=0.2))
    chunks, errors = read_at(spoken("wck", 0.2), PROTOCOLS["wck"].baud)
    assert b"".join(c.data for c in chunks) == b"".join(f.wire for f in frames)
    assert not errors


# --- bytes, protocol, baud -----------------------------------------------------------------------


@in_turn(2)
@EVERY
def test_nothing_is_wrong_with_a_good_line(name: str) -> None:
    verdicts = diagnose(heard(name))
    assert [v for v in verdicts if v.level > Level.NOTE] == []
    assert said("protocol", heard(name)).text.startswith(f"{name} explains 100% of the bytes")
    assert said("baud", heard(name)).text == f"{PROTOCOLS[name].baud} is right: frames hold"


def test_silence_is_bad_and_nothing_more_is_guessed() -> None:
    silent = replace(heard(), chunks=())
    assert said("bytes", silent).level == Level.BAD
    assert said("bytes", silent).text == "no byte in 2.0 s"
    assert "ground" in said("bytes", silent).advice
    assert {v.about for v in diagnose(silent)}.isdisjoint({"protocol", "baud", "reads", "times"})


def test_silence_with_line_errors_is_a_line_read_wrongly() -> None:
    verdict = said("bytes", replace(heard(), chunks=(), risen=Counters(brk=7)))
    assert "7 line errors" in verdict.text
    assert "try another `baud`" in verdict.advice
    assert "try another --baud" in worded(verdict.advice)


def test_a_few_bytes_are_too_few_to_judge_by() -> None:
    case = heard()
    few = replace(case, chunks=case.chunks[:2])
    assert said("bytes", few).level == Level.NOTE
    assert said("bytes", few).advice == "listen longer: `seconds=30`"
    assert worded(said("bytes", few).advice) == "listen longer: --duration 30"
    assert worst(diagnose(few)) < Level.BAD


def test_a_port_that_went_away_is_bad() -> None:
    verdict = said("bytes", replace(heard(), gone_s=1.25))
    assert (verdict.level, verdict.text.partition(";")[0]) == (
        Level.BAD,
        "the port went away after 1.2 s",
    )


def test_another_protocol_than_the_one_named_is_told() -> None:
    verdict = said("protocol", replace(heard("rs30x"), protocol="wck"))
    assert verdict.level == Level.BAD
    assert verdict.advice == "this is rs30x: sniffer doctor /dev/ttyUSB0=rs30x@115200"


@in_turn(4)
@EVERY
@pytest.mark.parametrize("factor", [4, 2, 0.5, 0.25])
def test_the_wrong_baud_is_bad_where_line_errors_are_told(name: str, factor: float) -> None:
    baud = int(PROTOCOLS[name].baud * factor)
    verdict = said("baud", misheard(name, baud))
    assert verdict.level == Level.BAD
    assert verdict.text.startswith(f"{baud} is most likely ")
    assert str(PROTOCOLS[name].baud) in verdict.advice
    assert said("protocol", misheard(name, baud)).level == Level.BAD


@in_turn(4)
@EVERY
def test_far_too_fast_is_seen_from_the_bytes_alone(name: str) -> None:
    baud = 4 * PROTOCOLS[name].baud
    verdict = said("baud", misheard(name, baud, told=False))
    assert (verdict.level, verdict.text.partition(":")[0]) == (
        Level.BAD,
        f"{baud} is most likely too high",
    )
    tried = [int(b) for b in verdict.advice.rpartition("with ")[2].split(", ")]
    assert PROTOCOLS[name].baud in tried
    assert max(tried) < baud


def test_a_baud_that_was_tried_and_explains_more_is_told() -> None:
    case = misheard("mightyzap", 115200)
    trials = (
        Trial(230400, understand(misheard("mightyzap", 230400).chunks)),
        Trial(57600, understand(heard("mightyzap").chunks)),
    )
    verdict = said("baud", replace(case, trials=trials))
    assert verdict.level == Level.BAD
    assert verdict.text.startswith("57600 baud explain 100% of the bytes as mightyzap, 115200")
    assert verdict.commands == ("sniffer doctor /dev/ttyUSB0=mightyzap@57600",)
    assert [t["baud"] for t in verdict.numbers["trials"]] == [230400, 57600]


def test_bauds_that_were_tried_in_vain_are_not_advised() -> None:
    case = misheard("mightyzap", 115200)
    verdict = said("baud", replace(case, trials=(Trial(9600, understand(case.chunks)),)))
    assert verdict.advice.startswith("none of 9600 is better")


def test_the_likeliest_baud_is_tried_first() -> None:
    assert usual_bauds("mightyzap", 115200)[0] == 57600
    assert usual_bauds("auto", 115200)[0] == 57600
    assert usual_bauds("auto", 57600)[0] == 115200
    every = {b for p in PROTOCOLS.values() for b in p.bauds}
    assert set(usual_bauds("auto", 115200)) == every - {115200}


# --- errors and losses ---------------------------------------------------------------------------


def marked(chunks: Sequence[Chunk], kind: MarkKind, every: int) -> list[Chunk]:
    return [
        replace(c, marks=(Mark(kind, 0, len(c.data), len(c.data)),)) if not i % every else c
        for i, c in enumerate(chunks)
    ]


@pytest.mark.parametrize(
    ("risen", "level", "text"),
    [
        (Counters(), Level.OK, "no framing error, parity error or break"),
        (Counters(frame=2), Level.WARN, "2 line errors"),
        (Counters(frame=200, brk=9), Level.BAD, "209 line errors"),
    ],
)
def test_line_errors_are_judged_by_their_share(risen: Counters, level: Level, text: str) -> None:
    verdict = said("errors", replace(heard(), risen=risen))
    assert (verdict.level, verdict.text[: len(text)]) == (level, text)


def test_counters_know_better_than_marks_that_an_adapter_repeats() -> None:
    case = heard()
    case = replace(case, chunks=marked(case.chunks, MarkKind.FRAMING, 20))
    assert said("errors", replace(case, risen=Counters(frame=3))).numbers["line_errors"] == 3
    assert said("errors", replace(case, risen=None)).level == Level.BAD


def test_a_port_that_tells_of_no_errors_is_not_called_clean() -> None:
    deaf = replace(heard(), risen=None, marks_errors=False)
    assert said("errors", deaf).level == Level.NOTE
    assert said("errors", deaf).numbers["line_errors"] is None
    assert said("losses", deaf).level == Level.NOTE


def test_bytes_lost_on_our_side_are_bad() -> None:
    assert said("losses", heard()).level == Level.OK
    verdict = said("losses", replace(heard(), risen=Counters(overrun=1, buf_overrun=2)))
    assert (verdict.level, verdict.numbers["lost"]) == (Level.BAD, 3)
    case = replace(heard(), risen=None)
    lossy = replace(case, chunks=marked(case.chunks[:1], MarkKind.OVERRUN, 1))
    assert said("losses", lossy).level == Level.BAD


# --- the adapter ---------------------------------------------------------------------------------


def slow(name: str = "mightyzap") -> Listened:
    """Return a bus heard through an adapter whose timer is what it is from the factory."""
    case = heard(name, every_ns=16 * MS)
    info = replace(FTDI, latency_ms=16)
    return replace(case, info=info, facts={**FACTS, "latency_timer_ms": "16"})


def test_a_long_timer_is_told_with_what_lowers_it() -> None:
    verdict = said("latency", slow())
    assert (verdict.level, verdict.numbers["timer_ms"]) == (Level.WARN, 16)
    assert verdict.commands == (
        "echo 1 | sudo tee /sys/bus/usb-serial/devices/ttyUSB0/latency_timer",
        'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"',
    )


def test_a_timer_that_opening_has_lowered_is_told() -> None:
    verdict = said("latency", replace(heard(), info=replace(FTDI, latency_ms=16)))
    assert verdict.level == Level.OK
    assert "it was 16 ms" in verdict.text


def test_an_adapter_without_a_timer_is_no_fault() -> None:
    facts = {**FACTS, "latency_timer_ms": "none"}
    info = replace(FTDI, chip="CP2102", driver="cp210x", latency_ms=None)
    unknown = replace(heard(), facts=facts, info=info, latency_ns=None)
    assert said("latency", unknown).level == Level.NOTE
    assert said("latency", replace(unknown, latency_ns=2 * MS)).level == Level.OK
    assert "a guess" in said("times", unknown).text


def test_replies_in_one_read_with_their_request_cost_the_response_times() -> None:
    assert said("reads", heard()).level == Level.OK
    verdict = said("reads", slow())
    assert verdict.level == Level.WARN
    assert verdict.numbers["merged"] > 0.7 * verdict.numbers["pairs"]
    assert said("times", slow()).level == Level.WARN
    assert "replies begin" in said("times", heard()).text
    assert "replies begin" not in said("times", slow()).text


def test_a_quick_adapter_may_merge_what_is_close() -> None:
    case = replace(slow("wck"), latency_ns=2 * MS)
    assert said("reads", case).level == Level.NOTE


@pytest.mark.parametrize(
    ("facts", "level", "word"),
    [
        ({"modem_after_open": "none", "modem_after_lowering": "none"}, Level.OK, "no such"),
        ({"modem_after_open": "all low"}, Level.OK, "are low"),
        ({"modem_after_open": "CTS"}, Level.OK, "are low"),
        ({}, Level.NOTE, "RTS and DTR were raised by opening the port, and lowered"),
        ({"modem_after_lowering": "RTS CTS"}, Level.BAD, "RTS cannot be lowered"),
        ({"modem": "keep", "modem_after_lowering": "not lowered"}, Level.WARN, "stay so"),
        ({"modem": "keep", "modem_after_open": "DTR"}, Level.NOTE, "DTR was raised"),
    ],
)
def test_what_opening_did_to_rts_and_dtr(facts: dict[str, str], level: Level, word: str) -> None:
    verdict = said("modem", replace(heard(), facts={**FACTS, **facts}))
    assert verdict.level == level
    assert word in verdict.text


def test_a_second_reader_is_bad() -> None:
    facts = {**FACTS, "also_open_in": "ModemManager (process 812)"}
    verdict = said("access", replace(heard(), facts=facts))
    assert verdict.level == Level.BAD
    assert "ModemManager (process 812)" in verdict.text


def test_a_name_that_changes_with_plugging_is_told_with_one_that_stays() -> None:
    verdict = said("port", replace(heard(), info=FTDI))
    assert verdict.text == "FT232R (ftdi_sio) FTDI FT232R USB UART, serial A6008isP"
    assert (verdict.level, verdict.commands) == (Level.NOTE, (FTDI.stable,))
    assert said("port", replace(heard(), path=FTDI.stable, info=FTDI)).level == Level.OK


def test_nothing_is_known_of_a_port_elsewhere_and_nothing_is_claimed() -> None:
    case = replace(heard(), path="socket://tap:4000", info=None, facts={}, has_line=False)
    case = replace(case, latency_ns=None, risen=None, marks_errors=False)
    levels: Iterable[Observation] = diagnose(case)
    assert {v.about: v.level for v in levels if v.level > Level.NOTE} == {}
    assert "any baud will do" in said("baud", case).text
