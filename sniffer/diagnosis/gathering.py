"""Findings of one kind that several servos have, told as one: an incident of a chain is no list."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from sniffer.ground.wording import servos

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from sniffer.decoding.called import ServoNames
    from sniffer.diagnosis.model import Finding

SEVERAL: Final = 3
"""Servos whose findings of one kind are told by the first one's."""


def steps(findings: Iterable[Finding]) -> list[str]:
    """Return the few words of findings, once where several servos have them alike."""
    whose: dict[tuple[str, ...], list[int]] = {}
    for f in findings:
        if f.brief:
            parts = re.split(rf"\bservo {f.servo_id}\b", f.brief, maxsplit=1)
            ids = whose.setdefault(tuple(parts), [])
            ids += [f.servo_id] if f.servo_id is not None and f.servo_id not in ids else []
    return [_who(ids).join(parts) for parts, ids in whose.items()]


def _who(ids: Sequence[int]) -> str:
    return f"each of {servos(ids)}" if len(ids) > 1 else servos(ids)


def gathered(findings: Sequence[Finding]) -> list[tuple[Finding, tuple[int, ...]]]:
    """Return the first finding of each kind that several servos have, with the other servos.

    The others as they are, with none; of several findings of one servo each is its own.
    """
    by_kind: dict[str, list[Finding]] = {}
    for f in findings:
        by_kind.setdefault(f.code, []).append(f)
    out: list[tuple[Finding, tuple[int, ...]]] = []
    for alike in by_kind.values():
        whose = [f.servo_id for f in alike if f.servo_id is not None]
        if len(whose) == len(alike) == len(set(whose)) >= SEVERAL:
            is_one = len({f.what for f in alike}) == 1  # it names them all
            out.append((alike[0], () if is_one else tuple(whose[1:])))
        else:
            out += [(f, ()) for f in alike]
    return out


def likewise(what: str, others: Sequence[int], names: ServoNames, bus: str) -> str:
    """Return what was found of one servo, and which others have it, too, by their names."""
    return f"{what}; likewise {names.sentence(bus, servos(others))}" if others else what
