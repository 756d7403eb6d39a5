"""The cases by name: each draws up scenarios for some protocols."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from bench.diagnosis.played.draft import drawn

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from bench.diagnosis.played.draft import Draft
    from bench.diagnosis.scenario import Scenario


class Case(NamedTuple):
    """One kind of scenario: its name, who can show it, what it adds to which setting."""

    name: str
    protocols: tuple[str, ...]
    add: Callable[[Draft], None]
    setting: dict[str, Any]


class Cases:
    """Collects cases; it is their decorator."""

    def __init__(self) -> None:
        self.all: list[Case] = []

    def __call__(
        self, *protocols: str, **setting: Any
    ) -> Callable[[Callable[[Draft], None]], Callable[[Draft], None]]:
        """Take a function as the case of its name, for these protocols; see ``drawn``."""

        def take(add: Callable[[Draft], None]) -> Callable[[Draft], None]:
            name = add.__name__.strip("_").replace("_", "-")
            self.all.append(Case(name, protocols, add, setting))
            return add

        return take

    def scenarios(self, draw: int) -> Iterator[Scenario]:
        """Yield the scenarios of all cases, as this draw has them."""
        for case in self.all:
            for protocol in case.protocols:
                name = f"{case.name}-{protocol}"
                draft = drawn(protocol, f"{name} {draw}", **case.setting)
                case.add(draft)
                yield draft.made(name, draw)


EVERY = ("mightyzap", "lss", "rs30x", "wck")
