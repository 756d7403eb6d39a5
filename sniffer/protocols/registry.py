"""The protocols by name: those that are built in, and the plug-ins.

Names are listed without importing anything; a protocol is loaded when it is first asked for. What
is wrong with a plug-in is told in one line, and keeps nobody from using the others.
"""

from __future__ import annotations

import importlib
import warnings
from collections.abc import ItemsView, Iterator, Mapping, Sequence, ValuesView
from typing import TYPE_CHECKING, Final

from sniffer.ground.loading import PluginWarning
from sniffer.protocols import plugins
from sniffer.protocols.base import BusProtocol
from sniffer.protocols.plugins import PluginError

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.protocols.plugins import Plugin

AUTO: Final = "auto"
"""Stands for a protocol that is to be told from the bytes."""


class Registry(Mapping[str, BusProtocol]):
    """Protocols by name, the built-in ones first; ``values`` and ``items`` are those that load.

    Args:
        built_in: by name ``module:PROTOCOL``, or a class of which one is made.
        signs: of built-in ones, sets of bytes of which each of its first frames has one whole.

    Raises:
        PluginError: what was asked for by its name is a plug-in that cannot be used.
    """

    def __init__(
        self, built_in: Mapping[str, str], signs: Mapping[str, Sequence[bytes]] | None = None
    ) -> None:
        self._built_in = dict(built_in)
        self._signs = {name: [frozenset(sign) for sign in of] for name, of in (signs or {}).items()}
        self._loaded: dict[str, BusProtocol] = {}
        self._plugins: dict[str, Plugin] | None = None
        self._files: dict[Path, BusProtocol] = {}
        self._origins: dict[str, str] = {}
        self._broken: dict[str, PluginError] = {}

    @property
    def built_in(self) -> tuple[str, ...]:
        """The names that need no plug-in."""
        return tuple(self._built_in)

    def __iter__(self) -> Iterator[str]:
        return iter(dict.fromkeys((*self._built_in, *self._listed(), *self._loaded)))

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __contains__(self, name: object) -> bool:
        return name in self._built_in or name in self._loaded or name in self._listed()

    def __getitem__(self, name: str) -> BusProtocol:
        if name in self._loaded:
            return self._loaded[name]
        if name in self._built_in:
            module, _, attribute = self._built_in[name].partition(":")
            found = getattr(importlib.import_module(module), attribute)
            return self._loaded.setdefault(name, found() if isinstance(found, type) else found)
        plugin = self._listed()[name]
        if name in self._broken:
            raise self._broken[name]
        try:
            protocol = plugins.load(plugin)
        except PluginError as error:
            self._broken[name] = error
            raise
        self._origins[name] = plugin.package
        return self._loaded.setdefault(name, protocol)

    def values(self) -> ValuesView[BusProtocol]:
        """Return the protocols that load; of the others a warning tells."""
        return _Values(self)

    def items(self) -> ItemsView[str, BusProtocol]:
        """Return the protocols that load, with their names; of the others a warning tells."""
        return _Items(self)

    def usable(self, name: str) -> BusProtocol | None:
        """Return a protocol; None, and a warning once, where it is a plug-in that does not load."""
        told = name in self._broken
        try:
            return self[name]
        except PluginError as error:
            if not told:
                _warn(str(error))
            return None

    def candidates(self, heard: bytes | None = None) -> list[BusProtocol]:
        """Return the protocols that are looked for where none is named.

        A plug-in is one of them if it says ``auto = True``: only here all of them are loaded.
        Built-in ones that cannot have a frame in ``heard`` are left out, and not even loaded.
        """
        there = None if heard is None else frozenset(heard)
        return [
            protocol
            for name in self
            if self._may_be(name, there) and (protocol := self.usable(name)) is not None
            if name in self._built_in or getattr(protocol, "auto", False) is True
        ]

    def _may_be(self, name: str, there: frozenset[int] | None) -> bool:
        signs = self._signs.get(name)
        return there is None or signs is None or any(sign <= there for sign in signs)

    def origin(self, name: str) -> str:
        """Return where a protocol comes from: a package, a file; empty: it is built in."""
        return "" if name in self._built_in else self._origins.get(name, "given as an object")

    def file(self, path: Path) -> BusProtocol:
        """Return the protocol that a file defines as ``PROTOCOL``; it is loaded once.

        From then on it is known by its name, too, also where a package has one of that name.

        Raises:
            PluginError: there is none in it that can be used.
        """
        where = path.resolve()
        if where not in self._files:
            protocol = plugins.load_file(where, str(path))
            if protocol.name in self._built_in:
                raise PluginError(
                    f"{path}: {protocol.name} is a protocol that is built in: call it otherwise"
                )
            self._origins[protocol.name] = where.name
            self._loaded[protocol.name] = protocol
            self._files[where] = protocol
        return self._files[where]

    def _listed(self) -> dict[str, Plugin]:
        """Return the plug-ins by name; what is wrong with a name itself is told here."""
        if self._plugins is None:
            found: dict[str, Plugin] = {}
            self._plugins = found
            why: list[str] = []
            for plugin in plugins.installed():
                if plugin.name in self._built_in or plugin.name == AUTO:
                    why.append(f"{plugin} is left out: that name is taken by a built-in one")
                elif not plugins.NAME.fullmatch(plugin.name):
                    why.append(f"{plugin} is left out: a name is made of A-Z a-z 0-9 _ -")
                elif plugin.name in found:
                    other = found[plugin.name].package
                    why.append(f"{plugin} is left out: {other} has that name, too")
                else:
                    found[plugin.name] = plugin
            for message in why:
                _warn(message)
        return self._plugins


class _Values(ValuesView[BusProtocol]):
    """What loads."""

    def __init__(self, registry: Registry) -> None:
        super().__init__(registry)
        self._registry = registry

    def __iter__(self) -> Iterator[BusProtocol]:
        return (protocol for _, protocol in self._registry.items())


class _Items(ItemsView[str, BusProtocol]):
    """What loads, by name."""

    def __init__(self, registry: Registry) -> None:
        super().__init__(registry)
        self._registry = registry

    def __iter__(self) -> Iterator[tuple[str, BusProtocol]]:
        for name in self._registry:
            protocol = self._registry.usable(name)
            if protocol is not None:
                yield name, protocol


def _warn(message: str) -> None:
    warnings.warn(message, PluginWarning, stacklevel=3)
