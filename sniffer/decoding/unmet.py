"""Rules of one's own that judge nothing: no servo of any bus can meet them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.anomalies.alarms import refusal
from sniffer.ground.wording import and_
from sniffer.protocols.ids import shared_ids

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.decoder import Decoder
    from sniffer.decoding.mixed import MixedDecoder
    from sniffer.decoding.options import Options
    from sniffer.decoding.summary import Summary


def unmet(
    options: Options,
    decoders: Mapping[str, Decoder | MixedDecoder],
    summary: Summary | None = None,
) -> list[str]:
    """Tell of such rules, each in a sentence.

    Args:
        options: hold the rules, and what servos are called.
        decoders: by bus, what is spoken there.
        summary: who was heard, where nothing more will be: others meet no rule.
    """
    told = (
        (a, _why(a, options, decoders) or (summary and _absent(a, options, decoders, summary)))
        for a in options.alarms
        if decoders
    )
    return [f"the rule {str(a)!r} judges nothing: {why}" for a, why in told if why]


def _why(
    alarm: Alarm, options: Options, decoders: Mapping[str, Decoder | MixedDecoder]
) -> str | None:
    """Return why no servo of any bus can meet a rule; None: one can."""
    names = options.called
    mine = [d for bus, d in decoders.items() if alarm.on(bus, names.ids)]
    if mine:
        return refusal(alarm, {p.name: p for d in mine for p in d.protocols}.values())
    nobody = f"{alarm.called} is on none of the buses {and_(list(decoders))}"
    return names.nobody(alarm.called) or nobody


def _absent(
    alarm: Alarm,
    options: Options,
    decoders: Mapping[str, Decoder | MixedDecoder],
    summary: Summary,
) -> str | None:
    """Return that nothing was heard of the servos that a rule is about; None: of one, or of any."""
    everyone = {who for d in decoders.values() for p in d.protocols for who in shared_ids(p)}
    heard = {
        (name if name in decoders else name.rpartition(".")[0], who)  # of one protocol of several
        for name, bus in summary.buses.items()
        for who, _, _ in bus.by_command
        if who not in everyone
    }
    whose = [(bus, a.servo_id) for bus in decoders for a in alarm.on(bus, options.called.ids)]
    if not heard or any(who is None or (bus, who) in heard for bus, who in whose):
        return None
    there = ", ".join(str(who) for who in sorted({who for _, who in heard}))
    who = alarm.called or f"servo {alarm.servo_id}"
    return f"{who} is not in it: {'one of ' * (len(heard) > 1)}{there}"
