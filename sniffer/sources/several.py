"""Several inputs as one capture: the files of a rotation, or captures one after the other."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

from sniffer.ground.model import NS, DamagedInputError, InputError
from sniffer.sources import open_source
from sniffer.sources.source import Source

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from sniffer.ground.model import Chunk
    from sniffer.ground.registers import RegisterMap
    from sniffer.ground.wiring import Wiring

_AGREED = ("protocol.", "baud.", "model")
"""Facts that must be the same in all of them, or be said in one only."""


class SeveralSources(Source):
    """Inputs read one behind the other, in the order of their first times.

    Where one is damaged, what comes of the others is read all the same; it is told at the end.
    """

    def __init__(self, parts: Sequence[Source]) -> None:
        self._parts = sorted(parts, key=_first) if all(map(_has_times, parts)) else list(parts)
        formats = {part.format for part in parts}
        form = formats.pop() if len(formats) == 1 else "several"
        super().__init__(f"{self._parts[0].name} and {len(parts) - 1} more", form)

    @property
    def label(self) -> str:
        """What kind of input it is, in words."""
        return f"{len(self._parts)} inputs, one behind the other"

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
        ended: dict[str, int] = {}
        beside: str | None = None
        for part in self._parts:
            newest: dict[str, int] = {}
            try:
                for group in part:
                    _follow(group, newest, ended, part.name)
                    if beside is None and _is_beside(group, ended):
                        beside = part.name
                    yield group
            except DamagedInputError as error:
                damage.append(str(error))
            ended.update(newest)
            self.notes += [f"{part.name}: {note}" for note in part.notes]
        if beside is not None:
            self.notes.append(f"{beside} begins before the one in front of it ends: {MERGE}")
        if damage:
            raise DamagedInputError("; ".join(damage))

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
                    raise InputError(f"{told}: decode them one by one")
        return out

    def tables(self) -> list[RegisterMap]:
        """Return the register tables that are attached to recordings."""
        found = {table.model: table for part in self._parts for table in part.tables()}
        return list(found.values())

    def close(self) -> None:
        """Release them."""
        for part in self._parts:
            part.close()


NAMED_MOST: Final = 3
"""Files of a capture that its name has; of more it has the first."""

STANDARD_INPUT: Final = "standard input"
"""What it is called where files have their names."""


MERGE: Final = (
    "they are read one behind the other; `sniffer merge` makes one capture of them, in the order "
    "of time"
)
"""What is told of inputs that were recorded beside each other."""


def inputs_of(source: str | Path | Sequence[str | Path]) -> list[str | Path]:
    """Return the inputs of a capture, of one file or of several."""
    return [source] if isinstance(source, str | Path) else [*source]


def joined(inputs: Sequence[str | Path]) -> str:
    """Return the inputs of a capture as a command names them."""
    return " ".join(map(str, inputs))


def name_of(source: str | Path | Sequence[str | Path]) -> str:
    """Return what a capture is called, of one file or of several."""
    inputs = inputs_of(source)
    if len(inputs) > NAMED_MOST:
        return f"{inputs[0]} and {len(inputs) - 1} more"
    named = joined(inputs)
    return STANDARD_INPUT if named == "-" else named


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
    """Raise an InputError where an input is named twice."""
    named = [str(path) for path in paths]
    for name in named:
        if named.count(name) > 1:
            raise InputError(f"{name} is named twice")


def _follow(
    group: Sequence[Chunk], newest: dict[str, int], ended: Mapping[str, int], name: str
) -> None:
    """Note the latest times of an input; it may not begin before what is read before it ends."""
    for chunk in group:
        t_ns, bus = chunk.t_ns, chunk.bus
        if t_ns is None:
            continue
        if bus not in newest and t_ns < ended.get(bus, t_ns):
            why = "begins before the one in front of it has ended"
            raise InputError(f"{name} {why}: decode them one by one")
        newest[bus] = max(newest.get(bus, t_ns), t_ns)


def _is_beside(group: Sequence[Chunk], ended: Mapping[str, int]) -> bool:
    """Tell whether something in a group was said before another bus of earlier inputs fell silent.

    By more than a second: before that, hosts that fetch bytes late are out of order, too.
    """
    last = max(ended.values(), default=None)
    times = [chunk.t_ns for chunk in group if chunk.data and chunk.t_ns is not None]
    return last is not None and bool(times) and min(times) < last - NS


def _first(part: Source) -> int:
    return next((c.t_ns for g in part for c in g if c.data and c.t_ns is not None), 0)


def _has_times(part: Source) -> bool:
    return next((c.t_ns is not None for g in part for c in g if c.data), False)
