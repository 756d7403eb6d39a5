"""How to decode: what a user says, and what a recording says of itself."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

from sniffer.anomalies.alarms import alarm_in, on_bus, refusal
from sniffer.decoding.called import ServoNames, names_in, overlaid
from sniffer.decoding.names import apart, is_known, joined, protocols_named
from sniffer.decoding.pacing import ASSUMED
from sniffer.ground.limits import BAUDS, DURATION_MOST_NS, IDS, OFFSET_END, number_in
from sniffer.ground.model import InputError, SnifferError
from sniffer.ground.wiring import Wiring
from sniffer.ground.wording import Sentence, offered
from sniffer.protocols import PROTOCOLS, is_file, protocol_named
from sniffer.protocols.registry import AUTO as AUTO
from sniffer.protocols.tables import check_tables, known_models, owner_of, with_tables

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from sniffer.anomalies.alarms import Alarm
    from sniffer.decoding.called import Named
    from sniffer.ground.registers import RegisterMap
    from sniffer.protocols.base import BusProtocol

SINCE: Final = "rate_since"
"""Facts ``rate_since.<bus>``: the offset in the stream from which on its rate holds."""

ALARM: Final = "alarm."
"""Facts ``alarm.1`` and so on: the user's own rules."""


@dataclass(frozen=True, slots=True)
class Options:
    """How to decode: ``protocols``, ``bauds``, ``latencies`` by bus, the others for all buses.

    A protocol is a name, a file that defines one, or the protocol itself; ``"a+b"`` are two that
    share the wire. ``tables`` are models beside those they have, ``alarms`` the user's own rules.
    ``names``, by servo id or by bus and id, are what people call the servos or their joints.
    ``wiring`` says how the wires of a logic capture are read.
    ``begins``, by bus, is how many bytes of an input are left out: they were heard at other rates.
    """

    protocol: str | BusProtocol = AUTO
    protocols: Mapping[str, str | BusProtocol] = field(default_factory=dict)
    baud: int | None = None
    bauds: Mapping[str, int] = field(default_factory=dict)
    models: Mapping[int | None, str] = field(default_factory=dict)
    latency_ns: int | None = None
    latencies: Mapping[str, int] = field(default_factory=dict)
    tables: tuple[RegisterMap, ...] = ()
    alarms: tuple[Alarm, ...] = ()
    begins: Mapping[str, int] = field(default_factory=dict)
    names: Mapping[Named, str] = field(default_factory=dict)
    wiring: Wiring = field(default_factory=Wiring)

    @property
    def name(self) -> str:
        """Return the name of the protocol of all buses, or ``auto``."""
        return AUTO if self.protocol == AUTO else joined(protocols_named(self.protocol))

    @property
    def called(self) -> ServoNames:
        """What servos are called."""
        return ServoNames(self.names)

    def called_with(self, facts: Mapping[str, str]) -> ServoNames:
        """Return the same with what a recording calls its servos, where nobody said more."""
        return ServoNames(overlaid(names_in(facts), self.names))

    def alarms_on(self, bus: str) -> tuple[Alarm, ...]:
        """Return the rules that servos of a bus can meet; who is called otherwise has an id."""
        return on_bus(self.alarms, bus, self.called.ids)

    def check_called(self) -> None:
        """Refuse rules on a servo that nobody is called like, once it is known who is called what.

        Raises:
            InputError: it says which name is near.
        """
        for alarm in self.alarms:
            if alarm.called and (why := self.called.nobody(alarm.called)) is not None:
                raise InputError(f"{alarm}: {why}")

    @property
    def wired(self) -> Wiring:
        """What is said of the wires of a logic capture, with the rate, where one was stated."""
        return replace(self.wiring, baud=self.baud)

    def check(self, also: Iterable[str | BusProtocol] = ()) -> None:
        """Refuse models, tables and rules that are of no use, before anything is opened for them.

        ``also`` are the protocols of single buses that were named.

        Raises:
            SnifferError: nobody has such a model; a table is not for what is spoken; no servo can
                meet a rule.
        """
        named = (self.protocol, *self.protocols.values(), *also)
        own = {p.name: p for n in named if n != AUTO for p in protocols_named(n)}
        check_tables(self.tables, own, others=AUTO in named)
        for model in self.models.values():
            if owner_of(model, self.tables, own.values()) is None:
                known = offered(str(model), known_models(self.tables, own.values()))
                raise SnifferError(f"no model {str(model)[:40]!r}: {known}")
        if self.alarms:
            every = {p.name: p for p in PROTOCOLS.values()} if AUTO in named else {}
            speakers = [with_tables(p, self.tables) for p in (every | own).values()]
            for alarm in self.alarms:
                if (why := refusal(alarm, speakers)) is not None:
                    raise SnifferError(f"{alarm}: {why}")

    def spoken(self, named: str | BusProtocol) -> BusProtocol:
        """Return a protocol, with the further models that these options bring.

        Raises:
            SnifferError: there is none, or it does not take them.
        """
        return with_tables(protocol_named(named), self.tables)

    def all_spoken(self, named: str | BusProtocol) -> tuple[BusProtocol, ...]:
        """Return the protocols of a name, ``a`` or ``a+b``, each as ``spoken`` does."""
        return tuple(self.spoken(protocol) for protocol in protocols_named(named))

    def with_facts(
        self,
        facts: Mapping[str, str],
        attached: Callable[[], Sequence[RegisterMap]] = tuple,
    ) -> Options:
        """Return the options with what a recording knows about itself, where nobody said more.

        ``attached`` reads its register tables: it is asked for models that nobody else knows.

        Raises:
            InputError: it was made with a protocol that is not here, or a rule names nobody.
        """
        told = replace(self, protocols={**self._recorded(facts), **self.protocols})
        if self.baud is None and facts.get("rate") != ASSUMED:
            bauds = _numbers(facts, "baud.", *BAUDS)
            told = replace(told, bauds={**bauds, **self.bauds})
        told = told._found(facts)
        if self.latency_ns is None:
            latencies = _numbers(facts, "latency_ns.", 0, DURATION_MOST_NS)
            every = number_in(facts.get("latency_ns", ""), 0, DURATION_MOST_NS)
            if every is not None:
                told = replace(told, latency_ns=every)
            told = replace(told, latencies={**latencies, **self.latencies})
        told = replace(told, names=overlaid(names_in(facts), self.names))
        told.check_called()  # a recording's own rules may name who is not in this part of it
        if not self.alarms:
            told = replace(told, alarms=_alarms(facts))
        if not self.models:
            models: dict[int | None, str] = {}
            for key, model in facts.items():
                name, _, servo = key.partition(".")
                number = number_in(servo, 0, IDS - 1)
                if name == "model" and (not servo or number is not None):
                    models[number] = model
            told = replace(told, models=models)
            told = replace(told, tables=(*told.tables, *told._missing(attached)))
        return told

    def _found(self, facts: Mapping[str, str]) -> Options:
        """Return the options with rates that a recorder has found, and from where on they hold."""
        since = _numbers(facts, f"{SINCE}.", 0, OFFSET_END)
        rates = {b: r for b, r in _numbers(facts, "baud.", *BAUDS).items() if b in since}
        if not rates or self.baud is not None:
            return self
        starts = _numbers(facts, "offset.", 0, OFFSET_END)
        begins = {bus: max(at - starts.get(bus, 0), 0) for bus, at in since.items()}
        return replace(self, bauds={**rates, **self.bauds}, begins={**begins, **self.begins})

    def _recorded(self, facts: Mapping[str, str]) -> dict[str, str | BusProtocol]:
        """Return what each bus of a recording speaks.

        A file that was named stands for its protocol only, where that is among them.
        """
        known = {k.partition(".")[2]: v for k, v in facts.items() if k.startswith("protocol.")}
        if self.protocol == AUTO:
            for bus, name in known.items():
                if bus not in self.protocols and name != AUTO and not is_known(name):
                    package = f" ({owner})" if (owner := facts.get(f"plugin.{bus}")) else ""
                    told = (
                        "{bus} needs the protocol {name}{package}: install the package that has "
                        "it, or give its file with {protocol}"
                    )
                    raise InputError(Sentence(told, bus=bus, name=repr(name[:40]), package=package))
            return dict(known)
        one = isinstance(self.protocol, str) and len(apart(self.protocol)) == 1
        if one and is_file(self.protocol):
            own = protocol_named(self.protocol).name
            if own in known.values():
                return {b: self.protocol if name == own else name for b, name in known.items()}
        return {}

    def _missing(self, attached: Callable[[], Sequence[RegisterMap]]) -> list[RegisterMap]:
        """Return the tables of models that are named and not known here."""
        if not self.models:
            return []
        speakers = {*self.protocols.values(), self.protocol} - {AUTO}
        also = [protocol for p in speakers for protocol in protocols_named(p)]
        named = {m for m in self.models.values() if owner_of(m, self.tables, also) is None}
        return [table for table in attached() if table.model in named] if named else []


def _numbers(facts: Mapping[str, str], name: str, least: int, most: int) -> dict[str, int]:
    """Return what a recording says of its buses; what cannot be is left out."""
    told = {k.removeprefix(name): v for k, v in facts.items() if k.startswith(name)}
    numbers = {bus: number_in(text, least, most) for bus, text in told.items()}
    return {bus: number for bus, number in numbers.items() if number is not None}


def alarm_facts(alarms: Sequence[Alarm]) -> dict[str, str]:
    """Return what a recording says of the rules that it was judged by."""
    return {f"{ALARM}{nth}": str(alarm) for nth, alarm in enumerate(alarms, 1)}


def _alarms(facts: Mapping[str, str]) -> tuple[Alarm, ...]:
    """Return the rules that a recording was judged by; one of a later version is left out."""
    out = []
    for key, text in facts.items():
        if key.startswith(ALARM):
            with contextlib.suppress(InputError):
                out.append(alarm_in(text))
    return tuple(out)
