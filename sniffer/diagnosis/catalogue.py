"""What findings there are: each says what is so, and how it is known.

Rules bring their own entries (``rules/``); anomalies count as findings, too, under their own codes.
``docs/findings.md`` is written from here.
"""

from __future__ import annotations

from typing import NamedTuple


class FindingCode(NamedTuple):
    """One kind of finding: what it says, and how one knows.

    ``is_omission``: a program leaves something out; where several servos miss it that is one
    mistake, whenever each of them needs it. ``is_lasting``: it lasts until somebody does something,
    and is seen when the next goal comes, however long after what brought it about.
    ``is_its_own``: one servo is hit by itself, and by no chance; what befalls all of them chooses
    none. ``is_of_supply``: what feeds one servo feeds others; where several have it within seconds
    of each other that is one fault. ``is_manner``: it says in which way damage comes that others
    tell of; alone it has nothing to explain. ``remedy`` and ``settle`` say what to do, and what
    would settle it, where it is this finding that an incident is known by, and its cause's words
    are for other signs of that cause. ``concerns`` is what of a servo these are about, where that
    is not what the cause concerns.
    """

    code: str
    means: str
    known_by: str
    is_omission: bool = False
    is_lasting: bool = False
    is_its_own: bool = False
    is_of_supply: bool = False
    is_manner: bool = False
    remedy: str = ""
    settle: str = ""
    concerns: str | None = None
