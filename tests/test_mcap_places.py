"""Where the messages of a chunk begin: by the index, or by their looks, and at what price."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from mcap.opcode import Opcode

from sniffer.mcapfile import records
from sniffer.mcapfile.source import chunks
from tests.recordings import record, talk

if TYPE_CHECKING:
    from pathlib import Path

    import pytest

    from sniffer.ground.model import I64


def test_messages_are_told_in_one_pass_from_what_looks_like_messages_within_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[int] = []
    gather = records._gather

    def counted(data: bytes, at: I64, shift: int, dtype: str) -> Any:
        looked.append(len(at))
        return gather(data, at, shift, dtype)

    monkeypatch.setattr(records, "_gather", counted)
    head = struct.pack("<BQ", Opcode.MESSAGE, 91)
    bodies = [struct.pack("<HIQQ", 1, n, n, n) + head + bytes(60) for n in range(300)]
    data = b"".join(head + body for body in bodies)
    assert records._likely(data).tolist() == list(range(0, len(data), 100))
    assert max(looked) >= 600, "what is within each ends where that of the next begins"
    assert len(looked) == 2


def test_messages_that_the_index_names_are_not_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, sent = tmp_path / "run.mcap", talk("mightyzap")
    record(path, "mightyzap", sent)
    monkeypatch.delattr(records, "_likely")
    assert list(chunks(path)) == sent
