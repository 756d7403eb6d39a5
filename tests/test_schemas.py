"""What commands print for programs is what the schemas beside the register tables say."""

from __future__ import annotations

import contextlib
import os
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import jsonschema
import pytest

from sniffer.cli.doctor import doctor
from sniffer.cli.ports import show
from sniffer.protocols import PROTOCOLS
from tests.commands import records, within
from tests.golden import CAPTURES
from tests.lists import each_in_turn
from tests.schemas import hold_to
from tests.test_ports_list import FTDI, NATIVE

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tests.test_convert import Capsys

MODELS: Final = [m.model for name in PROTOCOLS.built_in for m in PROTOCOLS[name].models]


def validated(name: str, rows: Sequence[dict[str, Any]]) -> None:
    for row in rows:
        hold_to(name, row)
    broken = {key: value for key, value in rows[0].items() if key != "type"} | {"nothing": 1}
    with pytest.raises(jsonschema.ValidationError):
        hold_to(name, broken)


@each_in_turn(3, "model", MODELS)
def test_registers_are_told_as_their_schema_says(model: str, capsys: Capsys) -> None:
    validated("registers", records(within(capsys, "registers", model, "--format", "jsonl").out))


def test_ports_are_told_as_their_schema_says(capsys: Capsys) -> None:
    show([FTDI, NATIVE, replace(FTDI, holders=(), latency_ms=None)], "jsonl")
    validated("ports", records(capsys.readouterr().out))


def test_what_the_doctor_says_is_as_its_schema_says(capsys: Capsys) -> None:
    master, slave = os.openpty()
    with contextlib.ExitStack() as stack:
        stack.callback(os.close, master)
        stack.callback(os.close, slave)
        asked = [f"{os.ttyname(slave)}=lss@115200", "--duration", "0.2", "--format", "jsonl"]
        doctor.main(asked, standalone_mode=False)
    rows = records(capsys.readouterr().out)
    assert [row["type"] for row in rows][-2:] == ["verdict", "summary"]
    validated("doctor", rows)


def test_verdicts_on_rules_are_told_as_their_schema_says(capsys: Capsys, tmp_path: Path) -> None:
    """For people and for JUnit there was each figure in a sentence, for programs nothing."""
    rules, empty = tmp_path / "rules.toml", tmp_path / "empty.log"
    nothing = '[[rule]]\nname = "x"\nwhat = "value"\nquantity = "current"\nbelow = 1\n'
    rules.write_text(within(capsys, "check", "--example").out + nothing)
    empty.write_text("")
    names = "mightyzap_clean.log", "mightyzap_damaged.log"
    captures = [CAPTURES / name for name in names]
    asked: list[str | Path] = ["check", *captures, empty, "--rules", rules]
    text = within(capsys, *asked).out
    ran = within(capsys, *asked, "--format", "jsonl")
    rows = records(ran.out)
    validated("check", rows)
    assert ran.status == 2
    assert [row["type"] for row in rows].count("error") == 1
    of_rules = [row for row in rows if row["type"] == "rule"]
    for row in of_rules:
        word = row["verdict"] if row["holds"] else row["verdict"].upper()
        assert f"{word} " in text
        assert f"{row['rule']}: {row['figure']}" in text
        assert row["low"] is None or row["low"] <= row["high"]
    (supply,) = (row for row in of_rules if row["rule"] == "the supply holds" and not row["holds"])
    assert (supply["low"], supply["servo_id"]) == (pytest.approx(6.9), 1)
    for summary in (row for row in rows if row["type"] == "summary"):
        mine = [row for row in of_rules if row["source"] == summary["source"]]
        assert summary["failed"] == sum(row["verdict"] == "failed" for row in mine)
        assert not summary["holds"]
