"""The manuals' example frames as data; see README.md beside this file."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

FOLDER = Path(__file__).parent

WCK_SET_OPS: Final = {
    0x08: "baud_rate_set",
    0x09: "pd_gain_set",
    0x0A: "pd_gain_read",
    0x0B: "runtime_pd_gain_set",
    0x0C: "id_set",
    0x0D: "speed_set",
    0x0E: "speed_read",
    0x0F: "overload_set",
    0x10: "overload_read",
    0x11: "boundary_set",
    0x12: "boundary_read",
    0x15: "i_gain_set",
    0x16: "i_gain_read",
    0x17: "runtime_speed_set",
    0x18: "runtime_i_gain_set",
    0x64: "io_write",
    0x65: "io_read",
    0x96: "motion_data_write",
    0x97: "motion_data_read",
    0xC8: "position_move_10bit",
    0xC9: "position_read_10bit",
}
"""wCK: op byte of the set family and its name, as the manual prints them (A-6, command table)."""


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
