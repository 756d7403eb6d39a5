"""What the doctor says of adapters that echo, and of drivers that are deaf or may be."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import pytest

from sniffer.cli.doctor import lines
from sniffer.doctor import Level, Listened, diagnose, judged
from sniffer.ground.model import MarkKind
from sniffer.ports import Counters
from sniffer.ports.drivers import DRIVERS, UART, Tells
from tests.test_doctor import FACTS, heard, marked, said

PREPARE: Final = "`sniffer doctor --prepare`"


def echoing(echo: str, sent: str) -> Listened:
    return replace(heard(), facts={**FACTS, "echo_at_open": echo, "sent_since_plugged": sent})


@pytest.mark.parametrize(
    ("echo", "sent", "level", "words"),
    [
        ("off", "0", Level.OK, "nothing was sent back"),
        ("off", "not known", Level.OK, "nothing was sent back"),
        ("off", "57", Level.OK, "the port has sent 57 bytes in all since it was plugged in"),
        ("on", "0", Level.NOTE, "switched off at once"),
        ("on", "57", Level.WARN, "the port has sent 57 bytes in all since it was plugged in"),
        ("on", "not known", Level.WARN, "switched off at once"),
    ],
)
def test_a_port_that_nobody_prepared_is_told_with_what_it_may_have_sent(
    echo: str, sent: str, level: Level, words: str
) -> None:
    verdict = said("echo", echoing(echo, sent))
    assert verdict.level == level
    assert words in verdict.text
    assert (PREPARE in verdict.advice) == (echo == "on")
    assert ("leave TX open" in verdict.advice) == (level == Level.WARN)
    known = int(sent) if sent.isdecimal() else None
    assert verdict.as_dict()["echo_at_open"] == echo
    assert verdict.as_dict()["sent_since_plugged"] == known


def test_nothing_is_said_of_an_echo_that_is_not_ours() -> None:
    facts = {key: value for key, value in FACTS.items() if key != "echo_at_open"}
    assert "echo" not in {v.about for v in diagnose(replace(heard(), facts=facts))}


def told_by(tells: Tells, risen: Counters | None) -> Listened:
    """Return a bus without an error, heard through such a driver."""
    return replace(
        heard(),
        facts={**FACTS, "line_errors": tells.words},
        marks_errors=tells.marks,
        counts_errors=tells.counts,
        risen=risen,
    )


@pytest.mark.parametrize("driver", ["cp210x", "cdc_acm", "ch341-uart"])
@pytest.mark.parametrize("risen", [Counters(), None], ids=["counters of nought", "no counters"])
def test_a_line_is_not_called_clean_where_the_driver_may_be_deaf(
    driver: str, risen: Counters | None
) -> None:
    case = told_by(DRIVERS[driver], risen)
    errors, losses = said("errors", case), said("losses", case)
    assert (errors.level, losses.level) == (Level.NOTE, Level.NOTE)
    assert errors.numbers["line_errors"] is None
    assert losses.numbers["lost"] is None
    assert "no framing error" not in errors.text
    if DRIVERS[driver].marks is None:
        assert errors.text == f"{DRIVERS[driver].words}: only checksums are sure to show damage"
    text = " ".join(line.plain for line in lines(judged(case), 120))
    assert "no byte lost on this side" not in text


def test_a_driver_that_tells_is_believed() -> None:
    case = told_by(UART, Counters())
    assert said("errors", case).text == (
        "no framing error, parity error or break (marked in the stream, counted by the driver)"
    )
    assert said("losses", case).level == Level.OK
    marks_only = told_by(DRIVERS["pl2303"], None)
    assert said("errors", marks_only).text.endswith("(marked in the stream)")
    assert said("losses", marks_only).level == Level.NOTE


def test_an_error_is_told_of_also_where_nobody_knew_that_it_would_be() -> None:
    case = told_by(DRIVERS["cp210x"], Counters(frame=2))
    assert said("errors", case).text.startswith("2 line errors")
    assert "counted by the driver" in said("errors", case).text
    case = told_by(DRIVERS["cdc_acm"], Counters())
    case = replace(case, chunks=marked(case.chunks[:1], MarkKind.BREAK, 1))
    assert said("errors", case).numbers["line_errors"] == case.line_errors > 0
    assert said("errors", case).text.endswith("marked in the stream)")
    lossy = told_by(DRIVERS["cdc_acm"], Counters(overrun=1))
    assert (said("losses", lossy).level, said("losses", lossy).numbers["lost"]) == (Level.BAD, 1)
