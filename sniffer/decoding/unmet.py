"""Rules of one's own that judge nothing: no servo of any bus can meet them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sniffer.anomalies.alarms import refusal
from sniffer.ground.wording import and_

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.decoder import Decoder
    from sniffer.decoding.mixed import MixedDecoder
    from sniffer.decoding.options import Options


def unmet(options: Options, decoders: Mapping[str, Decoder | MixedDecoder]) -> list[str]:
    """Tell of such rules, each in a sentence.

    Args:
        options: hold the rules, and what servos are called.
        decoders: by bus, what is spoken there.
    """
    told = ((a, _why(a, options, decoders)) for a in options.alarms if decoders)
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
