"""One command a question, and all rows of a capture as tables to answer it from."""

from __future__ import annotations

import csv
import functools
import json
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import pandas as pd

if TYPE_CHECKING:
    from pathlib import Path

Ask = Callable[..., str]
"""Runs one command and returns what it printed."""


class Told:
    """All rows of one capture as tables, and who is spoken to most."""

    def __init__(self, path: Path, ask: Ask) -> None:
        self.path = path
        told: dict[str, list[dict[str, Any]]] = {}
        for line in ask("decode", path, "--format", "jsonl").splitlines():
            row = json.loads(line)
            told.setdefault(row["type"], []).append(row)
        self.frames = pd.DataFrame(told["frame"])
        self.exchanges = pd.DataFrame(told["transaction"])
        self.samples = pd.DataFrame(told["sample"])
        self.anomalies = pd.DataFrame(told["anomaly"])
        self.gaps = pd.DataFrame(told["gap"])
        said = self.frames.drop_duplicates("offset").set_index("offset").kind
        self.samples["kind"] = self.samples.offset.map(said)
        answers = self.frames[self.frames.kind == "response"]
        self.servo = int(answers.servo_id.mode()[0])
        self.op = str(answers.op.mode()[0])
        self.code = str(self.anomalies.code.mode()[0])
        at = self.samples[self.samples.quantity == "position"]
        self.middle = round(float(at.value.median()), 2)
        self.began = int(min(self.frames.t_start_ns.min(), self.gaps.t_ns.min()))

    @functools.cached_property
    def positions(self) -> pd.DataFrame:
        """The measured positions."""
        return self.samples[self.samples.quantity == "position"]


class Question:
    """One question to one capture; each of these runs one command."""

    def __init__(self, told: Told, ask: Ask, folder: Path) -> None:
        self.told, self._ask, self.folder = told, ask, folder

    def sql(self, text: str) -> list[tuple[Any, ...]]:
        """Return the rows of ``sniffer query``."""
        lines = self._ask("query", text, self.told.path, "--format", "json").splitlines()
        return [tuple(json.loads(line).values()) for line in lines]

    def stats(self, *options: str) -> dict[str, Any]:
        """Return the bus of ``sniffer stats``."""
        out = self._ask("stats", self.told.path, "--format", "json", *options)
        (bus,) = json.loads(out)["buses"]
        assert isinstance(bus, dict)
        return bus

    def offsets(self, kind: str, *options: str) -> list[int]:
        """Return where the rows of one kind begin that ``sniffer decode`` selects."""
        lines = self._ask("decode", self.told.path, "--format", "jsonl", *options).splitlines()
        rows = [row for row in map(json.loads, lines) if row["type"] == kind]
        return [row["evidence"][0][0] if kind == "anomaly" else row["offset"] for row in rows]

    def text(self, command: str, *arguments: str) -> str:
        """Return what a command prints for people."""
        return self._ask(command, *arguments)

    def table(self, *options: str) -> list[dict[str, str]]:
        """Return the rows that ``sniffer convert`` writes as CSV."""
        path = self.folder / "out.csv"
        self._ask("convert", self.told.path, path, *options)
        with path.open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))
