"""What is passed around of a capture: the task to decode it, the row of what became of it."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from typing import Any, Final

from sniffer.ground.model import SnifferError
from sniffer.ground.wording import as_text
from sniffer.sources.stretches import Sizes

OK: Final = "ok"
DAMAGED: Final = "damaged"
"""It breaks off, or is in parts no capture: what could be read is in the data set."""
FAILED: Final = "failed"
"""Nothing of it is in the data set; it is not tried again unless that is asked for."""
CRASHED: Final = "crashed"
"""It ended the process that decoded it, each time; every run tries it again."""

EACH: Final = 1 << 24
"""Bytes of a stretch of a huge capture, whoever decodes it: 2 s of work, 1.6 % of it warm-up."""

HUGE: Final = Sizes(least=EACH, most=EACH)
"""How huge captures are read. It depends on nothing but the capture: so do the batches in which it
is decoded, and the bytes of its tables, which show where batches end."""

STATUSES: Final = (OK, DAMAGED, FAILED, CRASHED)


class UndividedError(Exception):
    """A capture cannot be decoded by several processes."""


class UndoneError(SnifferError):
    """A capture was not decoded for a reason that is not its own: try again.

    ``errno`` is what the system said, 0 where it said nothing.
    """

    def __init__(self, message: str, errno: int = 0) -> None:
        super().__init__(message, errno)  # both, so that another process can have it
        self.errno = errno

    def __str__(self) -> str:
        return str(self.args[0])


class WorkerDiedError(SnifferError):
    """A worker process died of a capture as often as it was tried."""


@dataclass(frozen=True, slots=True)
class CaptureTask:
    """One capture to be decoded into a data set: all that another machine must know of it.

    ``uri`` is where it lies, ``size`` in bytes, ``mtime_ns`` when it was changed last. ``robot`` is
    whose it is, ``dataset`` the root of the data set. ``recipe`` says how it is decoded
    (``recipe.read_recipe``), ``decoder`` names recipe and program, ``fingerprint`` all of that.
    ``sizes`` are those of the stretches in which it is read, if it is huge.
    """

    uri: str
    size: int
    mtime_ns: int
    robot: str
    dataset: str
    recipe: str
    decoder: str
    fingerprint: str
    sizes: Sizes = HUGE

    @property
    def is_huge(self) -> bool:
        """Whether it is read in stretches, if it is such that it can be."""
        return self.size >= self.sizes.smallest

    @property
    def path(self) -> str:
        """Where it lies, as a text that tables can hold: names of files may be none."""
        return as_text(self.uri)


@dataclass(frozen=True, slots=True)
class CaptureRow:
    """What became of a capture: a row of ``captures.parquet``, and its commit.

    ``capture`` is its id in all tables, from its bytes (of one that could not be read: its
    fingerprint). ``date`` is the day in UTC of its first time, or where that tells none of the last
    change of its file (``date_from``: ``stamp``, ``mtime``). ``bytes`` are those of its file.
    ``t_first_ns`` and ``t_last_ns`` are None without a clock. ``frames`` to ``anomalies`` count
    rows of the tables, ``errors`` the anomalies that are errors. ``summary`` is the summary record
    of the JSON lines, ``files`` are paths below the root, ``seconds`` is how long decoding took.
    """

    path: str
    robot: str
    date: str
    bytes: int
    decoder: str
    fingerprint: str
    capture: str
    status: str
    date_from: str = "mtime"
    error: str = ""
    buses: tuple[str, ...] = ()
    protocols: tuple[str, ...] = ()
    t_first_ns: int | None = None
    t_last_ns: int | None = None
    frames: int = 0
    samples: int = 0
    transactions: int = 0
    anomalies: int = 0
    errors: int = 0
    bytes_in_gaps: int = 0
    summary: str = ""
    files: tuple[str, ...] = ()
    sha256: str = ""
    seconds: float = 0.0

    def as_json(self) -> str:
        """Return it as a commit holds it."""
        return json.dumps({name: getattr(self, name) for name in self.__slots__}, sort_keys=True)

    @classmethod
    def from_json(cls, text: str) -> CaptureRow:
        """Return what a commit holds; keys of later versions are left out.

        Raises:
            ValueError: it is no commit.
        """
        told = json.loads(text)
        try:
            known: dict[str, Any] = {
                f.name: tuple(v) if isinstance(v := told[f.name], list) else v
                for f in fields(cls)
                if f.name in told
            }
            return cls(**known)
        except TypeError as error:
            raise ValueError(f"no commit of a capture: {error}") from None
