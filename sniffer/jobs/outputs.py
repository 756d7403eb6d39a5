"""Outputs of a job: what they say of themselves, opened all or none, looked after at the end."""

from __future__ import annotations

import contextlib
import datetime
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from sniffer import __version__
from sniffer.decoding.called import name_facts
from sniffer.decoding.options import SINCE, alarm_facts
from sniffer.decoding.pacing import ASSUMED
from sniffer.ground.files import (
    TABLES,
    files_of,
    is_lost,
    occupied,
    open_binary,
    probe,
    refuse_occupied,
)
from sniffer.ground.model import OutputError
from sniffer.ground.wording import and_
from sniffer.messages import CUT, OFFSET, TOOL
from sniffer.sinks import BYTES, RECORDING, open_sink, suffix_known
from sniffer.sinks.raw import RAW_FILES

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from sniffer.decoding.pipeline import Options
    from sniffer.decoding.sink import Sink
    from sniffer.jobs.aside import Aside
    from sniffer.jobs.telling import Teller
    from sniffer.mcapfile.joints import RosJoint
    from sniffer.sinks.raw import RawFile

GONE: Final = "{} is gone: it was deleted or renamed while it was written"
"""What is told of an output that is no more where it was."""

ORIGIN: Final = "origin"
"""Facts ``origin.tool``, ``.source``, ``.written`` of the recording that it was made from."""

NOBODY: Final = "a capture without names"
"""What stands for the source of what is to tell nobody's name."""

_MADE: Final = ("tool", "source", "written")

_ANEW: Final = frozenset(
    {*_MADE, "protocol", "plugin", "baud", "rate", SINCE, "latency_ns", "model", "alarm"}
    | {"offset", "topics", "joints", "name"}
)
"""Facts of a recording that are said anew of what is made of it, or are not true of it."""


def session_facts(
    source: str | None, options: Options, known: Mapping[str, str] | None = None
) -> Mapping[str, str]:
    """Return the facts of a recording that are known before its first byte.

    Where no source is to be named, it is not said either when the recording was written.
    ``known`` are those of the recording that is read: its rates and latencies are handed on.
    """
    facts = {
        "tool": f"{TOOL} {__version__}",
        "source": NOBODY if source is None else source,
        "protocol": options.name,
    }
    if source is not None:
        facts["written"] = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    known = known or {}
    told = {k: v for k, v in known.items() if k.startswith(("baud.", "latency_ns."))}
    if options.baud is not None:
        facts["baud"] = str(options.baud)
    elif known.get("rate") != ASSUMED and any(k.startswith("baud.") for k in told):
        facts |= {k: v for k, v in told.items() if k.startswith("baud.")}
    else:
        facts["rate"] = ASSUMED  # what stands as a bus's rate is the protocol's usual one
    for key in (k for k in known if k.startswith(f"{SINCE}.")):  # but where it was found
        rate = f"baud.{key.removeprefix(f'{SINCE}.')}"
        facts |= {key: known[key], rate: known.get(rate, "")}
    if options.latency_ns is not None:
        facts["latency_ns"] = str(options.latency_ns)
    else:
        facts |= {k: v for k, v in told.items() if k.startswith("latency_ns.")}
    for servo, model in options.models.items():
        facts["model" if servo is None else f"model.{servo}"] = model
    return _handed_on(known) | facts | name_facts(options.names) | alarm_facts(options.alarms)


def told_part(facts: Mapping[str, str]) -> str | None:
    """Return a sentence on a recording that is a part of a capture, None where it is a whole."""
    if f"{CUT}.source" not in facts:
        return None
    begin = f"{CUT}.{OFFSET}."
    places = {key.removeprefix(begin): at for key, at in facts.items() if key.startswith(begin)}
    where = and_([f"byte {at} of {bus}" for bus, at in places.items()])
    return f"a part of {facts[f'{CUT}.source']}, from {where or 'its begin'} on"


def _handed_on(known: Mapping[str, str]) -> dict[str, str]:
    """Return what a recording says of itself that stays true of what is made of it.

    Who made it, when, and of what, becomes its origin; the first one's, where that had one, too.
    """
    kept = {k: v for k, v in known.items() if k.partition(".")[0] not in _ANEW}
    first = {f"{ORIGIN}.{key}": known[key] for key in _MADE if key in known}
    return first | kept


class Wide(NamedTuple):
    """Tables have a column for each quantity of a servo; ``hold``: blanks repeat the last value.

    ``every_ns``: a bus has a row each such step of time, with what was said last in it.
    """

    hold: bool = False
    every_ns: int | None = None


class Contents(NamedTuple):
    """What a recording has beside the raw bytes: ``topics`` and ``joints`` of ``McapSink``."""

    topics: Sequence[str] | None = None
    joints: Sequence[RosJoint] | None = None


def open_outputs(
    paths: Sequence[Path], facts: Mapping[str, str], source: str, *, force: bool
) -> list[Sink]:
    """Open outputs of what is decoded; none may be the input itself, and none is named twice."""
    for path in paths:
        suffix_known(path)
    return open_all(paths, facts, [source], force=force)[0]


def open_all(
    paths: Sequence[Path],
    facts: Mapping[str, str],
    sources: Sequence[str],
    *,
    force: bool,
    wide: Wide | None = None,
    contents: Contents | None = None,
    aside: Aside | None = None,
) -> tuple[list[Sink], list[RawFile]]:
    """Open the outputs; return those of what is decoded, and those of the bytes themselves.

    All is checked before anything is opened, and what is to be replaced (``force``) is opened last:
    a mistake leaves no file behind and empties none. ``aside`` holds what is replaced.
    """

    def written(path: Path) -> tuple[Path, ...]:
        return files_of(path, wide=wide is not None)

    suffixes = [suffix_known(path, raw=True) for path in paths]
    files = [file for path in paths for file in written(path)]
    check_outputs(files, sources, force=force)
    new = [file for file in files if not file.exists()]
    if aside is not None:
        aside.take(files)
    out: dict[int, Sink] = {}
    raw: dict[int, RawFile] = {}
    try:
        for nth in sorted(range(len(paths)), key=lambda n: any(map(occupied, written(paths[n])))):
            if suffixes[nth] in BYTES:
                raw[nth] = RAW_FILES[suffixes[nth]](paths[nth])
            elif wide is not None and suffixes[nth] in TABLES:
                from sniffer.sinks.wide import WideSink

                out[nth] = WideSink(paths[nth], hold=wide.hold, every_ns=wide.every_ns)
            elif contents is not None and suffixes[nth] == RECORDING:
                from sniffer.mcapfile.sink import McapSink

                out[nth] = McapSink(
                    paths[nth], facts, topics=contents.topics, joints=contents.joints
                )
            else:
                out[nth] = open_sink(paths[nth], facts)
    except BaseException:
        for file in raw.values():
            with contextlib.suppress(OutputError):
                file.close()
        for sink in out.values():
            with contextlib.suppress(OutputError):
                sink.close()
        for path in new:
            with contextlib.suppress(OSError):
                path.unlink()
        if aside is not None:
            aside.restore()
        raise
    return [out[nth] for nth in sorted(out)], [raw[nth] for nth in sorted(raw)]


def check_outputs(
    files: Sequence[Path], sources: Sequence[str], *, force: bool, later: bool = False
) -> None:
    """Refuse files that cannot be outputs, before anything is opened.

    ``later``: they are made at the end only, so it is tried now whether they can be.

    Raises:
        OutputError: one is an input, is named twice, holds something, or may not be written.
    """
    for file in files:
        if any(_is_input(file, source) for source in sources):
            raise OutputError(f"{file} is the input: choose another output")
    for nth, file in enumerate(files):
        if any(_is_same(file, other) for other in files[:nth]):
            raise OutputError(f"{file} would be written twice: choose another output")
    if not force:
        refuse_occupied(files)
    for file in files:
        probe(file)
        if later and not file.exists():
            open_binary(file).close()
            file.unlink()


def _is_same(file: Path, other: Path) -> bool:
    """Tell whether two names are those of one file; a device takes any number of outputs."""
    with contextlib.suppress(OSError):
        if file.samefile(other):
            return file.is_file()
    return file.resolve() == other.resolve()


def _is_input(file: Path, source: str) -> bool:
    try:
        read = os.fstat(sys.stdin.fileno()) if source == "-" else Path(source).stat()
        return os.path.samestat(file.stat(), read) and not file.is_char_device()
    except (OSError, ValueError):
        return False


def gone(paths: Sequence[Path], tell: Teller, *, wide: bool = False) -> tuple[Path, ...]:
    """Tell which files are gone although they were written: deleted, or renamed; return them."""
    files = tuple(file for path in paths for file in files_of(path, wide=wide) if is_lost(file))
    for file in files:
        tell.warn(GONE.format(file))
    return files
