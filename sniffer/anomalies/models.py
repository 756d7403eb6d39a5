"""What the wire shows about which model a servo is, and scales that its values contradict."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.anomalies.evidence import AGAINST, GIVEN_UP, LIKELY, TAKEN
from sniffer.anomalies.rules import anomaly
from sniffer.ground.clues import DEFAULT, NUMBER, RANGE, READ, SURE, TEXT, WORD, WRITTEN
from sniffer.ground.memory import Remembering
from sniffer.ground.registers import unseen_scale
from sniffer.protocols.ids import shared_ids

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.anomalies.learned import Meaning, MetClue, ScaleMisfit, Told
    from sniffer.ground.model import Anomaly, Batch
    from sniffer.protocols.base import BusProtocol

SPANS = 4
"""So many frames are named as evidence, the latest first."""


class ModelRules(Remembering):
    """Tells what was weighed; remembers which scales were doubted."""

    LASTING = ("_doubted",)

    def __init__(self, protocol: BusProtocol) -> None:
        self._protocol = protocol
        self._doubted: set[tuple[int, int, int]] = set()

    def judge(self, batch: Batch, meaning: Meaning) -> Iterator[Anomaly]:
        """Report verdicts on models, and each contradicted scale of a servo once."""
        for told in meaning.told:
            yield self._verdict(batch, told)
        for misfit in meaning.misfits:
            register = self._protocol.registers[misfit.register]
            key = misfit.servo_id, misfit.mode, register.address
            if key not in self._doubted:
                self._doubted.add(key)
                yield self._misfit(batch, misfit)

    def _verdict(self, batch: Batch, told: Told) -> Anomaly:
        v = told.verdict
        names = [m.model for m in self._protocol.models]
        best, rival = v.model, v.instead_of
        if rival == best:
            rival = max((k for k in range(len(names)) if k != best), key=lambda k: v.points[k])
        score = f"{v.points[best]} points to {v.points[rival]}"
        who = f"servo {v.servo}"
        text = {
            LIKELY: f"{who} looks like {names[best]} but is read as {names[rival]}"
            f" ({score}; taken from {SURE} ahead)",
            TAKEN: f"{who} is read as {names[best]} from here on, not as {names[rival]} ({score})",
            GIVEN_UP: f"{who} is read as {names[0]} again: what speaks for {names[rival]} is"
            f" no longer {SURE} points ahead",
            AGAINST: f"{who} is read as {names[rival]}, as it was named, but looks like"
            f" {names[best]} ({score})",
        }[v.what]
        clues = "; ".join(self._clue(w, best, rival) for w in reversed(told.weighed))
        option = _option(self._protocol, v.servo, names[best])
        if v.what == AGAINST:
            remedy = f"Name it {option} if it is one; if not, look who talks to it so."
        else:
            other = _option(self._protocol, v.servo, names[rival])
            remedy = f"Decode again with {option}, or with {other} if it is that."
        t_ns, here = self._place(batch, told.row)
        # a servo that takes another id is told of there: its clues are older than that
        spans = dict.fromkeys((here, *(w.span for w in reversed(told.weighed))))
        detail = f"{text}: {clues}" if clues else text
        evidence = list(spans)[:SPANS]
        return anomaly("model-evidence", t_ns, v.servo, detail, *evidence)._replace(remedy=remedy)

    @staticmethod
    def _place(batch: Batch, row: int) -> tuple[int, tuple[int, int]]:
        """Return when and where a frame stands."""
        f = batch.frames
        return int(f.t_end[row]), (batch.base + int(f.start[row]), int(f.length[row]))

    def _clue(self, w: MetClue, best: int, rival: int) -> str:
        """Say what one clue is, by the names the two models have for its bytes."""
        clue = w.clue
        models, place = self._protocol.models, f"0x{clue.address:02X}"
        held = max(best, rival, key=lambda k: clue.points[k])
        lost = rival if held == best else best
        raw = int.from_bytes(w.data, "little")
        name, other = clue.known[held], clue.known[lost]
        model, missing = models[held].model, models[lost].model
        said = self._protocol.op_name(w.op)
        if clue.kind == TEXT:
            text = w.data.decode("ascii", "replace")
            return f"{said} {text} is a {name.replace('_', ' ')} of {model}"
        if clue.kind == WORD:
            return f"{said}, which is answered, is {name} of {model}, nothing on {missing}"
        sent = f"{said} {place} {w.data.hex(' ').upper()}"
        where = [m.at(clue.address) for m in (models[held], models[lost])]
        bounds = [str(list(r.range)) if r and r.range else "" for r in where]
        if clue.kind in (WRITTEN, READ):
            lacks = f"{other} of {missing} in part" if other else f"nothing on {missing}"
            return f"{sent} is {name or 'named'} of {model}, {lacks}"
        if clue.kind == RANGE:
            return (
                f"{sent} = {raw} fits {name} of {model} {bounds[0]}".rstrip()
                + f", not {other} of {missing} {bounds[1]}".rstrip()
            )
        if clue.kind == DEFAULT:
            return f"{sent} = {raw} is the default of {name} of {model}, not on {missing}"
        assert clue.kind == NUMBER
        return f"{sent} = {raw} is the {name.replace('_', ' ')} of {model}"

    def _misfit(self, batch: Batch, m: ScaleMisfit) -> Anomaly:
        r = self._protocol.registers[m.register]
        assert r.scale_by is not None
        assert r.range is not None
        name, scales = r.scale_by
        most = r.range[1] * unseen_scale(r)
        text = (
            f"servo {m.servo_id}: {r.name} {m.raw} would be {m.raw * scales[m.mode & 255]:.2f}"
            f" {r.unit} of {most:.2f} at {name} {m.mode}, which is not believed any more"
        )
        others = [
            x.model
            for x in self._protocol.models
            if (same := x.at(r.address)) is not None and same.type == r.type and not same.scale_by
        ]
        options = " or ".join(_option(self._protocol, m.servo_id, model) for model in others)
        remedy = f"Read {name} on the wire." + (
            f" If it is another model: {options}." if options else ""
        )
        t_ns, at = self._place(batch, m.row)
        return anomaly("model-evidence", t_ns, m.servo_id, text, at)._replace(remedy=remedy)


def _option(protocol: BusProtocol, servo: int, model: str) -> str:
    """Return the option that names a model; an id that only addresses all names none."""
    is_one = servo not in shared_ids(protocol)
    return f"`--model {servo}={model}`" if is_one else f"`--model {model}`"
