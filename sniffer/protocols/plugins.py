"""Plug-ins: protocols that other packages, or files, bring (docs/plugins.md).

A package names them in the group ``sniffer.protocols`` of its entry points. Listing them imports
nothing. Whatever a plug-in does wrong is a `PluginError` of one line.
"""

from __future__ import annotations

import functools
import importlib.util
import os
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

from sniffer.ground.model import DeclarationError, SnifferError
from sniffer.ground.registers import RegisterMap
from sniffer.protocols.base import BusProtocol

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import TracebackType

GROUP: Final = "sniffer.protocols"
"""The group of entry points in which a package names its protocols."""

INTERFACE: Final = 1
"""What ``interface`` of a plug-in must be. It changes when plug-ins made for it would not work."""

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}")
"""What a protocol may be called: nothing that could be a file, or several names."""


class PluginError(SnifferError):
    """A plug-in cannot be used; the message names it and says why."""


class Plugin(NamedTuple):
    """A protocol that a package brings: its name, the package with its version, how it is had."""

    name: str
    package: str
    load: Callable[[], Any]

    def __str__(self) -> str:
        return f"the plug-in {self.name!r:.40} of {self.package}"


def installed() -> list[Plugin]:
    """Return what packages name in the group, by the names of the packages."""
    if not _is_group_named():
        return []
    from importlib.metadata import distributions

    found: dict[tuple[str, str], Plugin] = {}
    for package in distributions():
        told = f"{package.metadata['Name']} {package.version}"
        for entry in package.entry_points:
            if entry.group == GROUP:
                # of two installations of a package the first one on the path is imported
                key = str(package.metadata["Name"]), entry.name
                found.setdefault(key, Plugin(entry.name, told, entry.load))
    return [found[key] for key in sorted(found)]


def _is_group_named() -> bool:
    """Tell whether a package on the path may name the group.

    Looking through 43 packages takes 1 ms; ``importlib.metadata`` takes 27 to be loaded and 8 to
    look, which everybody would pay who lets the protocol be told from the bytes.
    """
    mark = f"[{GROUP}]".encode()
    for folder in sys.path:
        try:
            with os.scandir(folder or ".") as entries:
                for entry in entries:
                    if not entry.name.endswith((".dist-info", ".egg-info")):
                        continue
                    try:
                        if mark in Path(entry.path, "entry_points.txt").read_bytes():
                            return True
                    except OSError:
                        continue
        except NotADirectoryError:
            return True  # an archive: who knows
        except OSError:
            continue
    return False


def load(plugin: Plugin) -> BusProtocol:
    """Import a plug-in and look whether it can be used."""
    try:
        found = plugin.load()
    except (Exception, SystemExit) as error:
        raise PluginError(f"{plugin} is left out: {_why(error)}") from error
    why = _unfit(found) or ("" if found.name == plugin.name else f"it calls itself {found.name!r}")
    if why:
        raise PluginError(f"{plugin} is left out: {why}")
    return cast("BusProtocol", found)


def load_file(path: Path, told: str) -> BusProtocol:
    """Run a file and return its ``PROTOCOL``; modules beside it are found as from a script."""
    if not path.is_file():
        raise PluginError(f"{told}: there is no such file")
    name = f"sniffer_protocol_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    before = sys.modules.get(name)
    sys.modules[name] = module
    sys.path.insert(0, str(path.parent))
    try:
        spec.loader.exec_module(module)
        found: Any = getattr(module, "PROTOCOL", None)
        why = "it defines no PROTOCOL" if found is None else _unfit(found)
        if not why and not NAME.fullmatch(found.name):
            why = f"{found.name!r} is no name of a protocol: it is made of A-Z a-z 0-9 _ -"
    except (Exception, SystemExit) as error:
        if before is None:
            del sys.modules[name]
        else:
            sys.modules[name] = before
        raise PluginError(f"{told}: {_why(error, path.parent)}") from error
    finally:
        sys.path.remove(str(path.parent))
    if why:
        raise PluginError(f"{told}: {why}")
    return cast("BusProtocol", found)


def _unfit(found: Any) -> str:
    """Say why something is no protocol that can be used; empty: it is one."""
    if isinstance(found, type):
        return f"{found.__name__} is a class: name an object of it"
    if hasattr(found, "packet") and hasattr(found, "commands"):
        return "PROTOCOL is a PacketFamily: write PROTOCOL = Member(PacketFamily(...))"
    told = getattr(found, "interface", None)
    if told != INTERFACE:
        lacks = "says no interface" if told is None else f"says interface = {told!r:.20}"
        return f"it {lacks}, this program has interface = {INTERFACE}"
    if missing := [name for name in _members() if not hasattr(found, name)]:
        more = ", ..." if len(missing) > 3 else ""
        return f"it lacks {', '.join(missing[:3])}{more}"
    if not isinstance(found.name, str):
        return "its name is no text"
    if not found.models or not all(isinstance(m, RegisterMap) for m in found.models):
        return "its models are no register tables"
    return ""


@functools.cache
def _members() -> tuple[str, ...]:
    """Return what a protocol must say."""
    names: dict[str, None] = {}
    for kind in BusProtocol.__mro__[:-1]:
        if kind.__module__.startswith("sniffer."):
            names |= dict.fromkeys(kind.__annotations__)
            names |= dict.fromkeys(name for name in vars(kind) if not name.startswith("_"))
    return tuple(names)


def _in(step: TracebackType | None, home: Path | None) -> bool:
    """Tell whether a step of a traceback is in a file of a folder."""
    return step is not None and Path(step.tb_frame.f_code.co_filename).parent == home


def _why(error: BaseException, home: Path | None = None) -> str:
    """Return what an exception says, and where it stood: in a file of ``home``, if it has one."""
    if isinstance(error, DeclarationError):
        return str(error)
    told = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    last = step = error.__traceback__
    while step is not None:
        # what a library says of a wrong call helps less than the line that called it
        if _in(step, home) or (step.tb_next is None and not _in(last, home)):
            last = step
        step = step.tb_next
    if last is None or "importlib" in last.tb_frame.f_code.co_filename:
        return told
    return f"{told} ({Path(last.tb_frame.f_code.co_filename).name}, line {last.tb_lineno})"
