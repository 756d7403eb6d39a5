"""What servos refuse: one command time and again, torque; and answers that only look like that."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sniffer.diagnosis.catalogue import FindingCode
from sniffer.diagnosis.model import Finding, Place
from sniffer.protocols.reports import meaning_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from sniffer.diagnosis.case import Case
    from sniffer.diagnosis.rules import Rule
    from sniffer.ground.model import I64

FINDINGS: Final = (
    FindingCode(
        "refuses-command",
        "A servo refuses one and the same command, time and again.",
        "At least three answers with a refusal (not of a checksum) to one command.",
    ),
    FindingCode(
        "echoes-differ",
        "What a servo repeats of one and the same command is something else now and then.",
        "Of twenty answers to one command, that have no status, fewer than four fifths differ from what they are to repeat: who refuses it does so each time.",
    ),
    FindingCode(
        "refuses-torque",
        "A servo refuses to have its torque switched on.",
        "Each write of its torque register was answered with a refusal.",
    ),
)

LEAST: Final = 3
"""Refusals of one command that are no accident."""

HABIT: Final = 20
MOSTLY: Final = 0.8
"""How often a command must be said to tell, and which part of the answers refuse what is refused."""

PLENTY: Final = 10


def refusals(case: Case) -> Iterator[Finding]:
    """Commands that a servo refuses again and again."""
    r = case.ledger.refusals.counted()
    for servo, op in sorted({*zip(r["servo_id"].tolist(), r["op"].tolist(), strict=True)}):
        rows = np.flatnonzero((r["servo_id"] == servo) & (r["op"] == op))
        worst = rows[np.argmax(r["n"][rows])]
        n, status = int(r["n"][rows].sum()), int(r["status"][worst])
        names = case.protocol.status_names(status) if status > 0 else ()
        meant = [meaning_of(case.protocol, name) for name in names]
        if n < LEAST or "checksum" in meant:  # what it got was not what was sent: the line's
            continue
        says = f" with {' and '.join(names).replace('_', ' ')}" if names else " with other values"
        command = _command(case, op, int(r["address"][worst]))
        said = _said(case, servo, op)
        if status <= 0 and said >= HABIT and n < MOSTLY * said:
            yield _at_times(case, servo, r, rows, n, said, command)
            continue
        others = f", of {len(rows)} addresses" if len(rows) > 1 else ""
        what = f"servo {servo} answers {command}{says}, {n} times{others}"
        at, length, t = (int(r[name][worst]) for name in ("at", "length", "t_first"))
        yield Finding(
            "refuses-command",
            servo,
            int(r["t_first"][rows].min()),
            int(r["t_last"][rows].max()),
            n,
            what,
            (Place(at, length, t, what),),
            strength=min(0.7 + n / PLENTY * 0.3, 1.0),
            brief=f"servo {servo} refuses {command}",
        )


def _said(case: Case, servo: int, op: int) -> int:
    """Return how often a servo was given a command."""
    kinds = case.ledger.exchanges.kinds
    mine = (np.array(kinds.servo_id) == servo) & (np.array(kinds.op) == op)
    return int(kinds.n[mine].sum())


def _at_times(
    case: Case,
    servo: int,
    r: Mapping[str, I64],
    rows: I64,
    n: int,
    said: int,
    command: str,
) -> Finding:
    """Return that answers to one command differ at times: nobody refuses what he does else."""
    first, last = int(r["t_first"][rows].min()), int(r["t_last"][rows].max())
    return Finding(
        "echoes-differ",
        servo,
        first,
        last,
        n,
        f"servo {servo} answers {command} with other values {n} times, and {said - n} times as it should",
        (Place(int(r["at"][rows[0]]), int(r["length"][rows[0]]), first, "answered otherwise"),),
        strength=min(0.5 + n / 40, 1.0),
        brief=f"answers of servo {servo} are others at times",
    )


def _command(case: Case, op: int, address: int) -> str:
    """Return a command with the register that it is for."""
    named = next((x.name for x in case.protocol.registers if 0 <= x.address == address), "")
    to = "" if address < 0 else f" of {named}" if named else f" at {address:#04x}"
    return f"{case.protocol.op_name(op)}{to}"


def torque_refused(case: Case) -> Iterator[Finding]:
    """Servos that refuse to have their torque switched on."""
    w = case.writes
    registers = case.protocol.registers
    is_torque = np.array([r.quantity == "torque_enable" for r in registers], bool)
    for row in np.flatnonzero((w["refused"] > 0) & is_torque[w["register"]]).tolist():
        servo, n, refused = (int(w[k][row]) for k in ("servo_id", "n", "refused"))
        if servo in case.everyone or refused < n:
            continue
        first, last = int(w["t_first"][row]), int(w["t_last"][row])
        name = registers[int(w["register"][row])].name
        what = f"servo {servo} refused each of {n} writes of {name}"
        yield Finding(
            "refuses-torque",
            servo,
            first,
            last,
            n,
            what,
            (Place(int(w["at"][row]), int(w["length"][row]), first, f"a write of {name}"),),
            strength=0.7 if n == 1 else 1.0,
            brief=f"servo {servo} refuses {name}",
        )


RULES: Final[tuple[Rule, ...]] = (refusals, torque_refused)
"""The rules of this area."""
