"""Codes explained in words, and words that were nearly right."""

from __future__ import annotations

import pytest

from sniffer.anomalies.catalogue import CATALOGUE
from sniffer.diagnosis.causes import CAUSES
from sniffer.diagnosis.rules import FINDINGS
from sniffer.ground.model import InputError
from sniffer.jobs.explain import read_hex
from sniffer.jobs.meanings import known_names
from tests.commands import within

Capsys = pytest.CaptureFixture[str]


def told(text: str) -> str:
    """Return a text as one line, wherever it was broken."""
    return " ".join(text.split())


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("no-response", ["anomaly"]),
        ("voltage-sag", ["finding"]),
        ("brownout", ["cause"]),
        ("id-changed", ["anomaly", "cause"]),
        ("Bad-Checksum", ["anomaly"]),
    ],
)
def test_a_name_is_explained_by_every_catalogue_that_has_it(
    name: str, kinds: list[str], capsys: Capsys
) -> None:
    ran = within(capsys, "explain", name)
    assert (ran.status, ran.err) == (0, "")
    name = name.lower()
    heads = [line for line in ran.out.splitlines() if line.startswith(f"{name}: ")]
    assert [head.removeprefix(f"{name}: ").split()[0].strip(",") for head in heads] == kinds
    said = told(ran.out)
    if name in CATALOGUE:
        code = CATALOGUE[name]
        assert all(told(text) in said for text in (code.means, code.causes, code.remedy))
    if name in FINDINGS:
        assert told(FINDINGS[name].means) in said
        assert told(FINDINGS[name].known_by) in said
    if name in CAUSES:
        cause = CAUSES[name]
        assert all(told(text) in said for text in (cause.means, cause.remedy, cause.settle))


def test_no_name_can_be_read_as_bytes() -> None:
    for name in known_names():
        with pytest.raises(InputError):
            read_hex(name)


@pytest.mark.parametrize(
    ("arguments", "meant"),
    [
        (["explain", "no-respnse"], "did you mean no-response"),
        (["explain", "brownuot"], "did you mean brownout"),
        (["explain", "limp"], "did you mean torque-off?"),
        (["decode", "x", "--protocol", "mightyzp"], "did you mean mightyzap?"),
        (["decode", "x", "--format", "jsn"], "did you mean jsonl?"),
        (["decode", "x", "--model", "wkc"], "did you mean wck?"),
        (["record", "x", "--topics", "fram"], "did you mean frames?"),
        (["decode", "x", "--format", "csv"], "made by `sniffer convert FILE x.csv`"),
        (["decode", "x", "--format", "candump"], "made by `sniffer convert FILE x.log`"),
        (["decode", "x", "--format", "jsnl"], "did you mean jsonl?"),
        (["record", "/dev/x=wkc"], "did you mean wck?"),
        (["registers", "mightyzap-l21"], "did you mean mightyzap-l12?"),
        (["simulate", "ls"], "did you mean lss?"),
        (["explain", "modem"], "see docs/anomalies.md"),
        (["explain", "no", "hex"], "write bytes as"),
    ],
    ids=lambda given: " ".join(given) if isinstance(given, list) else "",
)
def test_a_word_that_is_nearly_right_is_answered_with_the_right_one(
    arguments: list[str], meant: str, capsys: Capsys
) -> None:
    ran = within(capsys, *arguments)
    assert ran.status == 2
    assert meant in ran.complaint


@pytest.mark.parametrize(
    "text",
    [
        "FF FF FF 01 02 F1 0B",
        r"\xff\xff\xff\x01\x02\xf1\x0b",
        r"b'\xff\xff\xff\x01\x02\xf1\x0b'",
        "255 255 255 1 2 241 11",
        "255, 255, 255, 1, 2, 241, 11",
        "{0xFF, 0xFF, 0xFF, 0x01, 0x02, 0xF1, 0x0B}",
        "[255, 255, 255, 1, 2, 241, 11]",
        "FF-FF-FF-01-02-F1-0B",
        "TX: FF FF FF 01 02 F1 0B",
        "(1.0) bus0 #FFFFFF0102F10B",
    ],
)
def test_bytes_may_be_written_as_programs_print_them(text: str) -> None:
    assert read_hex(text).hex() == "ffffff0102f10b"


def test_a_line_of_text_may_end_as_it_does_in_a_program() -> None:
    assert read_hex(r"#5D1800\r") == b"#5D1800\r"


def test_hex_digits_with_dashes_between_are_no_code(capsys: Capsys) -> None:
    assert "7 bytes" in within(capsys, "explain", "FF-FF-FF-01-02-F1-0B").out
