"""The manuals' example frames as data; see README.md beside this file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parent


@dataclass(frozen=True, slots=True)
class Vector:
    """One example frame as printed."""

    protocol: str
    name: str
    source: str
    data: bytes
    kind: str
    verdict: str
    op: str = ""
    servo_id: int | None = None
    after: bytes = b""
    note: str = ""
    fields: dict[str, Any] = field(default_factory=dict)


def vectors(protocol: str) -> list[Vector]:
    """Read a protocol's vectors."""
    path = FOLDER / f"{protocol}.toml"
    out = []
    for v in tomllib.loads(path.read_text(encoding="utf-8"))["vector"]:
        text = protocol == "lss"
        raw = v["ascii"].encode("ascii") if text else bytes.fromhex(v["hex"])
        after = v.get("after", "")
        before = after.encode("ascii") if text else bytes.fromhex(after)
        out.append(
            Vector(
                protocol,
                v["name"],
                v["source"],
                raw,
                v["kind"],
                v["verdict"],
                v.get("op", ""),
                v.get("servo_id"),
                before,
                v.get("note", ""),
                v.get("fields", {}),
            )
        )
    return out
