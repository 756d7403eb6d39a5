"""What findings there are: each says what is so, and how it is known.

Rules bring their own entries (``rules/``); anomalies count as findings, too, under their own codes.
``docs/findings.md`` is written from here.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class FindingCode:
    """One kind of finding: what it says, and how one knows.

    ``is_omission``: a program leaves something out; where several servos miss it that is one
    mistake, whenever each of them needs it.
    """

    code: str
    area: str
    means: str
    known_by: str
    is_omission: bool = False
