"""Several inputs as one capture: the files of a rotation, or captures one after the other."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from dataclasses import replace
from itertools import chain, islice
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer.ground.files import STDIN
from sniffer.ground.limits import OFFSET_END, TIME_LEAST_NS, number_in
from sniffer.ground.model import DamagedInputError, InputError, Mark, MarkKind
from sniffer.messages import ANCHOR, CUT, OFFSET
from sniffer.sources import open_source
from sniffer.sources.source import Source

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from sniffer.ground.model import Chunk
    from sniffer.ground.registers import RegisterMap
    from sniffer.ground.wiring import Wiring

    _Heard = Callable[[Source, Sequence[Chunk]], Sequence[Chunk]]

_AGREED = ("protocol.", "baud.", "model")
"""Facts that must be the same in all of them, or be said in one only."""


class SeveralSources(Source):
    """Inputs read in the order of their times; without times one behind the other.

    Inputs that overlap in time are read side by side, if they are of different buses. Where one is
    damaged, what comes of the others is read all the same; it is told at the end.
    """

    def __init__(self, parts: Sequence[Source]) -> None:
        begins = [(part, t_ns) for part in parts if (t_ns := _first(part)) is not None]
        self._begins = sorted(begins, key=itemgetter(1)) if len(begins) == len(parts) else []
        self._parts = [part for part, _ in self._begins] or list(parts)
        formats = {part.format for part in parts}
        form = formats.pop() if len(formats) == 1 else "several"
        super().__init__(f"{self._parts[0].name} and {len(parts) - 1} more", form)

    @property
    def label(self) -> str:
        """What kind of input it is, in words."""
        return f"{len(self._parts)} inputs as one"

    @property
    def is_mixed(self) -> bool:
        """Whether lines of two taps may be mixed in one of them."""
        return any(part.is_mixed for part in self._parts)

    @property
    def size(self) -> int | None:
        """Bytes of all files; None where one is none."""
        sizes = [part.size for part in self._parts]
        return sum(size or 0 for size in sizes) if None not in sizes else None

    def hasten(self, payload: int, chunks: int) -> None:
        """Let the first group of the first of them have no more."""
        self._parts[0].hasten(payload, chunks)

    def __iter__(self) -> Iterator[Sequence[Chunk]]:
        self.notes.clear()
        damage: list[str] = []
        read = self._by_time if self._begins else self._one_by_one
        owners, joints = BusOwners(), _Joints()

        def heard(part: Source, group: Sequence[Chunk]) -> Sequence[Chunk]:
            return joints.told(part, owners.follow(part, group))

        yield from read(damage, heard)
        for part in self._parts:
            self.notes += [f"{part.name}: {note}" for note in part.notes]
        self.notes += joints.notes
        if damage:
            raise DamagedInputError("; ".join(damage))

    def _one_by_one(self, damage: list[str], heard: _Heard) -> Iterator[Sequence[Chunk]]:
        for part in self._parts:
            for group in _undamaged(part, damage):
                yield heard(part, group)

    def _by_time(self, damage: list[str], heard: _Heard) -> Iterator[Sequence[Chunk]]:
        """Yield what the inputs say in the order of time; one is opened when its time has come.

        What was read of several of them is one group: a pass costs the same whatever it holds.
        """
        waiting = deque(self._begins)
        read: list[_PartRead] = []
        merged: list[Sequence[Chunk]] = []
        while waiting or read:
            if empty := [one for one in read if not one.has_more]:
                if merged:  # nothing waits for what has yet to be read
                    yield merged[0] if len(merged) == 1 else [*chain.from_iterable(merged)]
                    merged = []
                for one in empty:
                    if not one.fill():
                        read.remove(one)
                continue
            now = min((one.next_ns for one in read), default=None)
            if waiting and (now is None or waiting[0][1] <= now):
                one = _PartRead(waiting.popleft()[0], damage)
                read += [one] if one.fill() else []  # its beginning was looked at: it is there
                continue
            one = min(read, key=_next)
            others = [other.next_ns for other in read if other is not one]
            others += [begin for _, begin in islice(waiting, 1)]
            piece = one.take(min(others, default=None))
            merged.append(heard(one.part, piece))

    def facts(self) -> Mapping[str, str]:
        """Return what the recordings among them know about themselves.

        Raises:
            InputError: they contradict each other.
        """
        out: dict[str, str] = {}
        for part in self._parts:
            for key, value in part.facts().items():
                if out.setdefault(key, value) != value and key.startswith(_AGREED):
                    told = f"{part.name} says {key} {value}, another {out[key]}"
                    raise InputError(f"{told}: {ONE_BY_ONE}")
        return out

    def tables(self) -> list[RegisterMap]:
        """Return the register tables that are attached to recordings."""
        found = {table.model: table for part in self._parts for table in part.tables()}
        return list(found.values())

    def close(self) -> None:
        """Release them."""
        for part in self._parts:
            part.close()


ONE_BY_ONE: Final = (
    "decode them one by one, or make one file of them with `sniffer merge` "
    "(`sniffer merge --pair`, if each heard one wire of one bus)"
)

NAMED_MOST: Final = 3
"""Files of a capture that its name has; of more it has the first."""

STANDARD_INPUT: Final = "standard input"


def inputs_of(source: str | Path | Iterable[str | Path]) -> list[str | Path]:
    """Return the inputs of a capture, of one file or of several; bytes raise an InputError."""
    if isinstance(source, bytes | bytearray | memoryview):
        raise InputError("a path is needed, or several: bytes are for `decode` and `Decoder`")
    try:
        return [source] if isinstance(source, str | Path) else [*source]
    except TypeError:
        raise InputError(f"a path is needed, or several, not {source!r}") from None


def joined(inputs: Sequence[str | Path]) -> str:
    """Return the inputs of a capture as a command names them."""
    return " ".join(map(str, inputs))


def name_of(source: str | Path | Sequence[str | Path]) -> str:
    """Return what a capture is called, of one file or of several."""
    inputs = inputs_of(source)
    if len(inputs) > NAMED_MOST:
        return f"{inputs[0]} and {len(inputs) - 1} more"
    return STANDARD_INPUT if (named := joined(inputs)) == "-" else named


def open_capture(
    source: str | Path | Sequence[str | Path],
    input_format: str = "auto",
    *,
    again: bool = False,
    wiring: Wiring | None = None,
) -> Source:
    """Open a capture, of one file or of several.

    ``again``: it is read more than once.

    Raises:
        InputError: it cannot be read.
    """
    paths = inputs_of(source)
    if len(paths) == 1:
        return open_source(paths[0], input_format, again=again, wiring=wiring)
    return open_sources(paths, input_format, wiring=wiring)


def open_sources(
    paths: Sequence[str | Path], input_format: str = "auto", *, wiring: Wiring | None = None
) -> Source:
    """Open several inputs as one.

    Raises:
        InputError: there is none, one cannot be read, or is named twice.
    """
    if not paths:
        raise InputError("there is no input: name a file")
    refuse_twice(paths)
    parts: list[Source] = []
    try:
        # their beginnings are looked at before they are read: a pipe is kept
        parts += (open_source(path, input_format, again=True, wiring=wiring) for path in paths)
        return SeveralSources(parts)
    except BaseException:
        for part in parts:
            part.close()
        raise


def refuse_twice(paths: Sequence[str | Path]) -> None:
    """Raise an InputError where an input is named twice, under whatever names."""
    met: dict[tuple[int, int] | str, str | Path] = {}
    for path in paths:
        key = _identity(path)
        if key in met:
            one, other = str(met[key]), str(path)
            raise InputError(
                f"{one} is named twice" if one == other else f"{one} and {other} are one file"
            )
        met[key] = path


def _identity(path: str | Path) -> tuple[int, int] | str:
    """Return by what a file is told from others; what cannot be looked at is told by its name."""
    if path == STDIN:
        return str(path)
    try:
        status = Path(path).stat()
    except (OSError, ValueError):
        return str(path)
    return status.st_dev, status.st_ino


_NO_MORE: Final = frozenset({MarkKind.ENDED, MarkKind.SILENT})


class BusOwners:
    """Which input tells of each bus: another one may go on with it, but not beside it."""

    def __init__(self) -> None:
        self._newest: dict[str, tuple[Source, int]] = {}
        self._past: set[tuple[str, Source]] = set()

    def follow(self, part: Source, group: Sequence[Chunk]) -> Sequence[Chunk]:
        """Note what an input says next; return it without what another input's going on tells.

        Raises:
            InputError: another one that speaks of that bus has begun before it ended.
        """
        out = [chunk for chunk in group if not self._is_over(part, chunk)]
        for chunk in out:
            bus, t_ns = chunk.bus, chunk.t_ns
            if t_ns is None:
                continue
            owner, newest_ns = self._newest.get(bus, (part, t_ns))
            if owner is not part:
                if (bus, part) in self._past:
                    raise _overlapping(owner)
                if t_ns < newest_ns:
                    raise _overlapping(part)
                self._past.add((bus, owner))
            self._newest[bus] = part, max(newest_ns, t_ns)
        return out

    def _is_over(self, part: Source, chunk: Chunk) -> bool:
        """Tell whether it only says that no more came, of a bus with which another one goes on.

        How each bus ends stands behind the bytes of all others, and of those one may end later.
        """
        ends = not chunk.data and all(mark.kind in _NO_MORE for mark in chunk.marks)
        return ends and (chunk.bus, part) in self._past


class _Recorded(NamedTuple):
    """What a file says of the whole that it is of, and the buses whose first bytes were read."""

    recorder: tuple[str, ...]
    facts: Mapping[str, str]
    begun: set[str]


class _Joints:
    """Where the files of one recorder go on with a bus, and where one of them is missing."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self._known: dict[Source, _Recorded] = {}
        self._ends: dict[tuple[tuple[str, ...], str], int] = {}

    def told(self, part: Source, group: Sequence[Chunk]) -> Sequence[Chunk]:
        """Return what a file says next, with a mark where bytes before it are in none."""
        if part not in self._known:
            facts = part.facts()
            recorder = tuple(facts.get(key, "") for key in (*ANCHOR, f"{CUT}.source"))
            self._known[part] = _Recorded(recorder, facts, set())
        mine, ends = self._known[part], self._ends
        if not any(mine.recorder):
            return group  # nobody knows what it goes on with
        marked: dict[int, Chunk] = {}
        for nth, chunk in enumerate(group):
            key = mine.recorder, chunk.bus
            if chunk.bus not in mine.begun:
                mine.begun.add(chunk.bus)
                at = f"{OFFSET}.{chunk.bus}"
                told = mine.facts.get(f"{CUT}.{at}", mine.facts.get(at, "0"))
                begin = number_in(told, 0, OFFSET_END) or 0
                missing = begin - ends.get(key, begin)
                if missing > 0:
                    mark = Mark(MarkKind.SKIPPED, 0, count=missing)
                    marked[nth] = replace(chunk, marks=(mark, *chunk.marks))
                    name = f"{chunk.bus}: {missing} bytes before {part.name}"
                    self.notes.append(f"{name} are in none of the files")
                ends[key] = begin
            ends[key] += len(chunk.data)
        return [marked.get(nth, chunk) for nth, chunk in enumerate(group)] if marked else group


class _PartRead:
    """An input that is being read: what it says next, and when that was."""

    def __init__(self, part: Source, damage: list[str]) -> None:
        self.part = part
        self._groups = _undamaged(part, damage)
        self._group: Sequence[Chunk] = ()
        self._times: list[int] = []
        """Of the chunks of the group. They never fall: a bus keeps the order that it has."""
        self._at = 0
        self._newest: dict[str, int] = {}
        self._last_ns = TIME_LEAST_NS

    @property
    def has_more(self) -> bool:
        """Whether something is left of the group; else ``fill`` is to be called."""
        return self._at < len(self._group)

    @property
    def next_ns(self) -> int:
        """When it says what is next."""
        return self._times[self._at]

    def take(self, until_ns: int | None) -> Sequence[Chunk]:
        """Return what it says up to a time, one chunk at least; None: the rest of the group."""
        at, group = self._at, self._group
        self._at = len(group)
        if until_ns is not None:
            self._at = max(at + 1, bisect_right(self._times, until_ns, at))
        return group if self._at - at == len(group) else group[at : self._at]

    def fill(self) -> bool:
        """Read the next group; tell whether there is one.

        A recording has what one bus said for a while, then what another one said meanwhile.
        """
        self._at, group = 0, next(self._groups, ())
        timed = [(self._newest_of(chunk), chunk) for chunk in group]
        timed.sort(key=itemgetter(0))
        self._group = [chunk for _, chunk in timed]
        # what was late to be written is said when it is read
        self._times = [max(t_ns, self._last_ns) for t_ns, _ in timed]
        self._last_ns = self._times[-1] if timed else self._last_ns
        return self.has_more

    def _newest_of(self, chunk: Chunk) -> int:
        """Return when the newest of a bus was said, of all up to a chunk."""
        newest = self._newest.get(chunk.bus, TIME_LEAST_NS)
        if chunk.t_ns is not None and chunk.t_ns > newest:
            newest = self._newest[chunk.bus] = chunk.t_ns
        return newest


def _undamaged(part: Source, damage: list[str]) -> Iterator[Sequence[Chunk]]:
    """Yield what an input holds; how it breaks off is added to the damage."""
    try:
        yield from (group for group in part if group)
    except DamagedInputError as error:
        damage.append(str(error))


def _overlapping(part: Source) -> InputError:
    why = "begins before the one in front of it has ended"
    return InputError(f"{part.name} {why}: {ONE_BY_ONE}")


def _next(one: _PartRead) -> int:
    return one.next_ns


def _first(part: Source) -> int | None:
    """Return when an input begins; None if its first bytes have no time, 0 if it has none."""
    return next((c.t_ns for g in part for c in g if c.data), 0)
