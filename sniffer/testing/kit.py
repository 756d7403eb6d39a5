"""The kit: everything that is held of a protocol, check by check, and the report."""

from __future__ import annotations

import functools
from collections import Counter
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from random import Random
from typing import TYPE_CHECKING, Final

from sniffer.anomalies.device import device_code
from sniffer.ground.model import Chunk, Clock, SnifferError
from sniffer.ground.timing import byte_time_ns
from sniffer.protocols import protocol_named
from sniffer.protocols.reports import reports_of, unheard_of
from sniffer.testing import laws
from sniffer.testing.arrange import (
    ARRANGEMENTS,
    DONE_LATER,
    NAMES,
    ONE_SILENT,
    SCENE,
    scene_of,
)
from sniffer.testing.coverage import goals, headers, lacking, table_of
from sniffer.testing.facts import facts_of, known_of, listed, plain
from sniffer.testing.faults import Suspects, faults_of, planted
from sniffer.testing.others import Others
from sniffer.testing.streams import recut
from sniffer.testing.talk import talk_of
from sniffer.testing.truth import BEGIN_NS, hear, judged, laid_out, wrong_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from sniffer.protocols.base import BusProtocol
    from sniffer.testing.case import TalkCase
    from sniffer.testing.facts import Fact, Known
    from sniffer.testing.faults import PlantedFault
    from sniffer.testing.talk import Exchange, Talk

EXAMPLES: Final = 30
"""Streams a law is held on; in a thorough run twenty times as many."""

BITES: Final = 500
"""Bytes fed one by one; in a thorough run all."""

ROW: Final = 4
"""Exchanges in a row that are fed byte by byte, and cases that the slow form is asked together."""

SLOW_CASES: Final = 200
"""Cases on which the slow form is asked; in a thorough run all."""

PLANTED: Final = 160
"""Faults that are planted, spread over all that there are; in a thorough run all."""

FIRST: Final = 24
"""Cases that a fault is shown first; most do not survive them."""

TOLD: Final = 6
"""Wrong cases that a message shows in full."""


@dataclass(frozen=True, slots=True)
class Requirement:
    """One thing that is held of a protocol; calling it raises AssertionError where it is not."""

    name: str
    run: Callable[[], str]

    def __call__(self) -> None:
        """Hold it."""
        self.run()

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True, slots=True)
class Report:
    """What came of all checks: by name what each saw, and what failed."""

    protocol: str
    seen: dict[str, str] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether all holds."""
        return not self.failed

    def report(self) -> str:
        """Return a line for each check, and what is wrong in full."""
        out = [f"{self.protocol}: {len(self.seen)} hold, {len(self.failed)} do not"]
        out += [f"  holds  {name}: {told}" for name, told in self.seen.items()]
        for name, told in self.failed.items():
            out += [f"  FAILS  {name}", *(f"         {line}" for line in told.splitlines())]
        return "\n".join(out)

    __str__ = report


class Kit:
    """A protocol and its talk; what several checks need is worked out once."""

    def __init__(self, protocol: BusProtocol, talk: Talk, *, thorough: bool, seed: int) -> None:
        self.protocol = protocol
        self.talk = replace(
            talk,
            exchanges=listed(protocol, talk.exchanges),
            scenes=[listed(protocol, scene) for scene in talk.scenes],
        )
        self.thorough, self.seed = thorough, seed
        self._company: dict[tuple[int, ...], set[int]] = {}
        if talk.model and talk.model not in {m.model for m in protocol.models}:
            raise SnifferError(f"{protocol.name} has no model {talk.model[:40]!r}")
        self.model = talk.model or (protocol.models[0].model if protocol.models else "")

    @property
    def listing(self) -> tuple[str, ...]:
        """The arrangement of requests that list whom they ask, where there are any."""
        return (ONE_SILENT,) if any(e.listed for e in self.talk.exchanges) else ()

    @functools.cached_property
    def known(self) -> list[Known]:
        """The exchanges that are decoded as labelled."""
        return known_of(self.protocol, self.talk.exchanges, self.model)

    @functools.cached_property
    def cases(self) -> list[TalkCase]:
        """All arrangements of them, and the scenes."""
        others = Others(self.protocol, self.known, thorough=self.thorough)
        understood = {id(k.exchange) for k in self.known}
        odd = [plain(e) for e in self.talk.exchanges if id(e) not in understood]
        made = [case for arrange in ARRANGEMENTS for k in self.known for case in arrange(k, others)]
        return [*odd, *made, *(scene_of(s) for s in self.talk.scenes)]

    @functools.cached_property
    def wrong(self) -> dict[int, str]:
        """The cases that are not decoded as labelled."""
        return wrong_of(self.protocol, self.cases, self.model)

    @functools.cached_property
    def suspects(self) -> Suspects:
        """The cases by what they could show, without those that are wrong anyway."""
        return Suspects(self.cases, self.wrong)

    @functools.cached_property
    def scenes(self) -> list[list[Fact]]:
        """The frames of each scene."""
        return facts_of(self.protocol, [scene_of(s) for s in self.talk.scenes], self.model)

    def truth(self, arrangement: str) -> str:
        """Hold the cases of an arrangement against their labels and the declared ambiguities."""
        mine = [k for k, c in enumerate(self.cases) if c.arrangement == arrangement]
        wrong = {k: why for k, why in self.wrong.items() if k in set(mine)}
        patterns = [x for x in self.talk.ambiguous if x.partition(": ")[0] == arrangement]
        found: dict[str, list[int]] = {x: [] for x in patterns}
        for k in wrong:
            key = self.cases[k].key
            pattern = next((x for x in patterns if fnmatchcase(key, x)), key)
            found.setdefault(pattern, []).append(k)
        out = []
        for key, some in found.items():
            declared = self.talk.ambiguous.get(key, 0)
            if self.thorough and declared and some:
                continue  # more cases are more ambiguous ones
            if len(some) != declared:
                out.append(f"{key}: {len(some)} differ from their labels, {declared} declared")
                out += [f"  {self.cases[k]}\n    {wrong[k]}" for k in some[: TOLD - len(out) // 2]]
        if out:
            raise AssertionError("\n".join(out))
        told = f"{len(mine)} cases"
        return f"{told}, {len(wrong)} of them ambiguous as declared" if wrong else told

    def misspelt(self) -> str:
        """Hold that what is declared exists: ambiguous cases, and meanings of errors."""
        keys = {c.key for c in self.cases}
        declared = self.talk.ambiguous
        unknown = [x for x in declared if not any(fnmatchcase(key, x) for key in keys)]
        if unknown:
            raise AssertionError(f"ambiguous cases declared that are none: {', '.join(unknown)}")
        meant = dict.fromkeys(reports_of(self.protocol).values())
        if nothing := [name for name in meant if device_code(name) == "device-alarm"]:
            slug = f"device-{nothing[0].replace('_', '-')}"
            raise AssertionError(f"reports: there is no anomaly {slug}: docs/anomalies.md has them")
        if wrong := unheard_of(self.protocol):
            raise AssertionError(wrong)
        return f"{len(self.talk.exchanges)} exchanges, {len(self.talk.scenes)} scenes"

    def slow(self) -> str:
        """Hold columns and slow form equal on the arrangements, a few in a row."""
        some = self.cases
        if not self.thorough:
            some = some[:: max(1, len(some) // SLOW_CASES)]
        for a in range(0, len(some), ROW):
            part = some[a : a + ROW]
            chunks = laid_out(self.protocol, part)
            with laws.bytes_told(chunks):
                laws.reference(self.protocol, chunks, Random(0))
        return f"{len(some)} cases"

    def bytewise(self) -> str:
        """Hold that exchanges fed byte by byte, cut at every boundary, are what they are whole."""
        total, each = 0, self._each()
        for a in range(0, len(each), ROW):
            data = b"".join(e.said for e in each[a : a + ROW])
            if not total or total + len(data) <= BITES or self.thorough:
                total += len(data)
                self._bites(data)
        return f"{total} boundaries"

    def _each(self) -> list[Exchange]:
        """Return the exchanges, one of each command first."""
        turn: Counter[str] = Counter()
        order = []
        for n, e in enumerate(self.talk.exchanges):
            turn[e.name] += 1
            order.append((turn[e.name], n))
        return [self.talk.exchanges[n] for _, n in sorted(order)]

    def _bites(self, data: bytes) -> None:
        chunks = [Chunk(data, BEGIN_NS + len(data) * byte_time_ns(self.protocol.baud), Clock.READ)]
        again = recut(Random(0), self.protocol, chunks, len(data))
        with laws.bytes_told(chunks):
            got = laws.decoded(self.protocol, [[c] for c in again])
            laws.equal("byte by byte", got, laws.decoded(self.protocol, [chunks]), chunks)

    def coverage(self) -> str:
        """Hold that the talk reaches everything, or says why it cannot."""
        names = (*NAMES, *self.listing)
        asked = goals(self.protocol, self.talk, self.known, self.scenes, self.cases, names)
        if missing := lacking(self.talk, asked):
            raise AssertionError("\n".join(missing))
        return (
            f"{sum(g.is_met for g in asked)} of {len(asked)} goals, the others absent with reason"
        )

    def faults(self) -> str:
        """Hold that no planted fault survives the talk."""
        table, header = table_of(self.protocol, self.talk), headers(self.known)[0]
        every = list(faults_of(self.protocol, table, self.known, self.scenes, header))
        step = 1 if self.thorough else -(-len(every) // PLANTED)
        some = every[self.seed % step :: step]
        alive = [fault.name for fault in some if self._survives(fault)]
        harmless = set(self.talk.harmless)
        out = [f"survives: {name}" for name in alive if name not in harmless]
        tried = {fault.name for fault in some}
        out += [
            f"said to be harmless, and it is {'not' if name in tried else 'none'}: {name}"
            for name in harmless - set(alive)
            if name in tried or name not in {fault.name for fault in every}
        ]
        if out:
            raise AssertionError("\n".join(out))
        told = f"{len(some) - len(alive)} killed, {len(every)} could be planted"
        return f"{told}, {len(alive)} harmless as declared" if alive else told

    def _survives(self, fault: PlantedFault) -> bool:
        broken = planted(self.protocol, fault)
        rows = self.suspects.of(fault)
        for a, b in ((0, FIRST), (FIRST, 1000), (1000, len(rows))):
            if rows[a:b] and self._tells(broken, tuple(rows[a:b])):
                return False
        return True

    def _tells(self, broken: BusProtocol, rows: tuple[int, ...]) -> bool:
        """Whether a case is wrong with the fault that is right without it, in the same company."""
        some = [self.cases[k] for k in rows]
        try:
            heard = hear(broken, some, self.model)
        except Exception:  # whatever it breaks, it is seen
            return True
        return not {k for k, h in enumerate(heard) if judged(some[k], h)} <= self._unsound(rows)

    def _unsound(self, rows: tuple[int, ...]) -> set[int]:
        """Return which of these cases are wrong without any fault, in the same company."""
        if rows not in self._company:
            some = [self.cases[k] for k in rows]
            heard = hear(self.protocol, some, self.model)
            self._company[rows] = {k for k, h in enumerate(heard) if judged(some[k], h)}
        return self._company[rows]


def checks(
    protocol: BusProtocol | str,
    talk: Talk | Iterable[Exchange],
    *,
    thorough: bool = False,
    seed: int = 0,
) -> list[Requirement]:
    """Return all that is held of a protocol, one call each, for a test runner that names them.

    Args:
        protocol: an object as ``sniffer.protocols.base`` describes it, or a name, or a file.
        talk: labelled exchanges.
        thorough: all combinations and many more streams, which takes minutes.
        seed: another one draws other streams.

    Raises:
        SnifferError: the talk is none, or there is no such protocol.
    """
    known = protocol_named(protocol)
    kit = Kit(known, talk_of(talk), thorough=thorough, seed=seed)
    exchanges = [*kit.talk.exchanges, *(e for s in kit.talk.scenes for e in s)]
    examples = EXAMPLES * (20 if thorough else 1)
    later = (DONE_LATER,) if any(e.later for e in kit.talk.exchanges) else ()

    def law(rule: Callable[..., None]) -> Callable[[], str]:
        def run() -> str:
            total = laws.hold(rule, known, exchanges, examples, seed)
            return f"{examples} streams, {total} bytes"

        return run

    return [
        Requirement("talk", kit.misspelt),
        *(
            Requirement(f"truth: {n}", functools.partial(kit.truth, n))
            for n in (*NAMES, *kit.listing, *later, SCENE)
        ),
        Requirement("law: columns say what the slow form says, arranged", kit.slow),
        Requirement("law: a cut at every boundary changes nothing", kit.bytewise),
        *(Requirement(f"law: {name}", law(rule)) for name, rule in laws.LAWS.items()),
        Requirement("coverage", kit.coverage),
        Requirement("faults", kit.faults),
    ]


def check(
    protocol: BusProtocol | str,
    talk: Talk | Iterable[Exchange],
    *,
    thorough: bool = False,
    seed: int = 0,
) -> Report:
    """Hold everything of a protocol, and return what came of it; arguments as for ``checks``."""
    result = Report(protocol_named(protocol).name)
    for one in checks(protocol, talk, thorough=thorough, seed=seed):
        try:
            result.seen[one.name] = one.run()
        except AssertionError as error:
            result.failed[one.name] = str(error)
    return result
