"""JUnit XML of rules: what a CI reads."""

from __future__ import annotations

from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

from sniffer.reports.judging import Decision, Judged
from sniffer.reports.junit import Suite, junit
from sniffer.reports.rules import rules_of
from tests.test_check import CLEAN, DAMAGED, checked, rule

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    Capsys = pytest.CaptureFixture[str]


def test_junit_has_a_suite_a_capture_and_a_case_a_rule(tmp_path: Path, capsys: Capsys) -> None:
    xml = tmp_path / "out.xml"
    text = (
        rule(name="heard <&> é", what="frames", at_least=1)
        + rule(name="supply", what="value", quantity="voltage", above=11)
        + rule(name="prompt", what="response_time_ms", below=1, undecided="pass")
    )
    ran = checked(capsys, tmp_path, text, CLEAN, DAMAGED, "--junit", xml)
    assert ran.status == 1
    root = ET.parse(xml).getroot()
    assert root.tag == "testsuites"
    assert {k: root.get(k) for k in ("tests", "failures", "errors")} == {
        "tests": "6",
        "failures": "2",
        "errors": "0",
    }
    clean, damaged = root.findall("testsuite")
    assert [s.get("name") for s in (clean, damaged)] == [str(CLEAN), str(DAMAGED)]
    assert [c.get("name") for c in clean] == ["heard <&> é", "supply", "prompt"]
    assert [[e.tag for e in c] for c in clean] == [
        ["system-out"],
        ["system-out"],
        ["skipped", "system-out"],
    ]
    failures = {c.get("name"): c.find("failure") for c in damaged}
    supply = failures["supply"]
    assert supply is not None
    assert (supply.get("type"), failures["heard <&> é"]) == ("failed", None)
    assert "6.9 V" in (supply.get("message") or "")
    for suite in (clean, damaged):
        assert suite.get("tests") == str(len(suite))
        assert suite.get("failures") == str(len(suite.findall("testcase/failure")))
        assert suite.get("skipped") == str(len(suite.findall("testcase/skipped")))


def test_junit_holds_whatever_a_capture_says() -> None:
    evil = 'a"<b>&\x00\x1b\ud800\ufffe\n'
    judged_ = Judged(rules_of(rule(what="frames", at_least=1))[0], Decision.FAILED, evil)
    root = ET.fromstring(junit([Suite(evil, [judged_], evil)]))
    assert root.get("errors") == root.get("failures") == "1"
    failure = root.find("testsuite/testcase/failure")
    assert failure is not None
    assert failure.get("message") == 'a"<b>&����\n'


def test_junit_replaces_nothing_unless_it_is_told_to(tmp_path: Path, capsys: Capsys) -> None:
    xml = tmp_path / "x.xml"
    xml.write_text("dear to somebody", encoding="ascii")
    text = rule(what="frames", at_least=1)
    ran = checked(capsys, tmp_path, text, CLEAN, "--junit", xml)
    assert ran.status == 2
    assert ran.complaint == f"{xml} is there already: choose another name, or --force"
    assert checked(capsys, tmp_path, text, CLEAN, "--junit", xml, "--force").status == 0
    over = checked(capsys, tmp_path, text, CLEAN, "--junit", tmp_path / "rules.toml", "--force")
    assert (over.status, over.complaint) == (
        2,
        f"{tmp_path}/rules.toml is the input: choose another output",
    )
    assert (tmp_path / "rules.toml").read_text(encoding="utf-8") == text
