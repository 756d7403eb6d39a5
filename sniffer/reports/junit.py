"""Verdicts as JUnit XML, as CI systems read it: a suite a capture, a case a rule.

The form is the one that Jenkins, GitLab and the reporters of GitHub take: ``testsuite`` with its
counts, ``testcase`` with ``failure`` or ``skipped``, and the figure as ``system-out``.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final, NamedTuple
from xml.etree import ElementTree as ET

from sniffer.reports.judging import Decision

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sniffer.reports.judging import Judged

_NOT_XML: Final = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 has no form for (2.2, Char)."""


class Suite(NamedTuple):
    """A capture with the verdicts on it; ``error`` says why it could not be judged to its end."""

    name: str
    verdicts: Sequence[Judged]
    error: str = ""


def junit(suites: Sequence[Suite]) -> str:
    """Return the verdicts on captures as a document."""
    root = ET.Element("testsuites", name="sniffer check")
    totals = dict.fromkeys(("tests", "failures", "errors", "skipped"), 0)
    for suite in suites:
        counts = {
            "tests": len(suite.verdicts) + bool(suite.error),
            "failures": sum(not j.holds for j in suite.verdicts),
            "errors": int(bool(suite.error)),
            "skipped": sum(j.holds and j.verdict != Decision.PASSED for j in suite.verdicts),
        }
        told = {"name": _told(suite.name)} | {key: str(n) for key, n in counts.items()}
        element = ET.SubElement(root, "testsuite", told)
        for judged in suite.verdicts:
            _case(element, suite, judged)
        if suite.error:
            case = _named(element, suite, "the capture can be read to its end")
            ET.SubElement(case, "error", message=_told(suite.error), type="damaged")
        for key, n in counts.items():
            totals[key] += n
    for key, n in totals.items():
        root.set(key, str(n))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=False) + "\n"


def _case(parent: ET.Element, suite: Suite, judged: Judged) -> None:
    case = _named(parent, suite, judged.rule.name)
    figure = _told(judged.figure)
    if not judged.holds:
        kind = judged.verdict.name.lower()
        failure = ET.SubElement(case, "failure", message=figure, type=kind)
        failure.text = f"{kind}: {figure}"
    elif judged.verdict == Decision.UNDECIDED:
        ET.SubElement(case, "skipped", message=figure)
    ET.SubElement(case, "system-out").text = figure


def _named(parent: ET.Element, suite: Suite, name: str) -> ET.Element:
    return ET.SubElement(parent, "testcase", classname=_told(suite.name), name=_told(name))


def _told(text: str) -> str:
    """Return a text without what XML cannot hold."""
    return _NOT_XML.sub("�", text)
