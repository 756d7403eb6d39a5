"""Our files put where Wireshark finds them, and taken away again; nobody else's are touched."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import resources
from typing import TYPE_CHECKING, Final

from sniffer import __version__
from sniffer.ground.files import writing
from sniffer.ground.model import OutputError
from sniffer.ground.wording import Sentence
from sniffer.wireshark.tables import dissector

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.wireshark.places import Places

MARK: Final = "Written by `sniffer wireshark install`"
"""Stands in every file that is ours. Wireshark leaves it out when it writes one anew because the
user has changed something: then it is theirs."""

ABSENT, OURS, OLDER, THEIRS = "not there", "installed", "of another version", "not ours"
"""What is where a file of ours belongs."""


@dataclass(frozen=True, slots=True)
class OwnFile:
    """One file: what it is, where it belongs, what it holds; ``runs``: it is a program."""

    what: str
    path: Path
    text: str
    runs: bool = False

    @property
    def state(self) -> str:
        """What is at its place: one of the states above.

        Raises:
            OutputError: it cannot be read.
        """
        if not self.path.exists():
            return ABSENT
        try:
            there = self.path.read_bytes()
        except OSError as error:
            raise OutputError(f"{self.path}: cannot be read ({error.strerror})") from None
        if there == self.text.encode():
            return OURS
        return OLDER if MARK.encode() in there else THEIRS


def pieces(places: Places) -> list[OwnFile]:
    """Return all files of ours, for these folders."""
    out = [OwnFile("dissector", places.plugins / "servo-sniffer.lua", dissector())]
    out += [
        OwnFile("profile", places.profile / name, _text("profile", name))
        for name in ("preferences", "colorfilters", "dfilter_buttons")
    ]
    program = _text("extcap").replace("@PYTHON@", sys.executable).replace("@VERSION@", __version__)
    for folder in places.extcap:
        if sys.platform == "win32":  # what runs there is told by the suffix
            script = folder / "servo-sniffer.pyw"
            batch = f'@rem {MARK}\r\n@"{sys.executable}" "{script}" %*\r\n'
            out += [
                OwnFile("capture interface", script, program),
                OwnFile("capture interface", folder / "servo-sniffer.bat", batch),
            ]
        else:
            out.append(OwnFile("capture interface", folder / "servo-sniffer", program, runs=True))
    return out


def install(places: Places, *, overwrite: bool = False) -> list[OwnFile]:
    """Write all files; return those that were not there as they are now.

    Raises:
        OutputError: one is there that is not ours, and nothing was written; or one cannot be.
    """
    every = pieces(places)
    states = {piece.path: piece.state for piece in every}
    for path, state in states.items():
        if state == THEIRS and not overwrite:
            told = "{file} is not ours, or was changed since: move it away, or {overwrite:True}"
            raise OutputError(Sentence(told, file=path))
    fresh = [piece for piece in every if states[piece.path] != OURS]
    for piece in fresh:
        with writing(piece.path):
            piece.path.parent.mkdir(parents=True, exist_ok=True)
            piece.path.write_bytes(piece.text.encode())
            if piece.runs:
                piece.path.chmod(0o755)
    return fresh


def uninstall(places: Places) -> tuple[list[OwnFile], list[OwnFile]]:
    """Remove what is ours, and the profile's folder if empty; return it, and what was left.

    Raises:
        OutputError: a file cannot be removed.
    """
    removed: list[OwnFile] = []
    left: list[OwnFile] = []
    for piece in pieces(places):
        state = piece.state
        if state in (OURS, OLDER):
            with writing(piece.path):
                piece.path.unlink()
            removed.append(piece)
        elif state == THEIRS:
            left.append(piece)
    if places.profile.is_dir() and not any(places.profile.iterdir()):
        places.profile.rmdir()
    return removed, left


def _text(*name: str) -> str:
    return resources.files("sniffer.wireshark").joinpath("files", *name).read_text("utf-8")
