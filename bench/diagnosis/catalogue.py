"""All scenarios: every module here that has some is asked, so that none is forgotten."""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

import bench.diagnosis

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bench.diagnosis.scenario import Scenario


def scenarios(draw: int = 0, only: str = "") -> Iterator[Scenario]:
    """Yield the scenarios whose names hold ``only``, drawn anew for each ``draw``.

    A module says which it has by a function ``scenarios(draw)``.
    """
    for found in sorted(pkgutil.iter_modules(bench.diagnosis.__path__), key=lambda m: m.name):
        if found.name in (__name__.rpartition(".")[2], "__main__"):
            continue
        module = importlib.import_module(f"bench.diagnosis.{found.name}")
        given = module.scenarios(draw) if hasattr(module, "scenarios") else ()
        yield from (scenario for scenario in given if only in scenario.name)
