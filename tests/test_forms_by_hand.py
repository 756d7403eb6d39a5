"""Packets of several forms without a header, framed by a plan of each: Modbus RTU is such.

ID | 03 | ADDRESS | COUNT | CRC        ID | 03 | BYTES | DATA ... | CRC
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from construct import Byte, Bytes, Check, Int16ul, this
from hypothesis import given
from hypothesis import strategies as st

from sniffer.ground.codes import REQUEST, RESPONSE
from sniffer.ground.crc import Crc16
from sniffer.ground.framing import Block, frame_by_plans
from sniffer.ground.plan import plan_of
from sniffer.protocols.packets import Packet, Seal

CRC: Final = Crc16(0x8005, 0xFFFF, reflected=True)


def form(*fields: Any) -> Any:
    head = ("servo_id" / Byte, "code" / Byte, Check(this.code == 3))
    names = ["servo_id", "code", *(field.name for field in fields if field.name)]
    return Packet(*head, *fields, "crc" / Seal(Int16ul, CRC, *names))


ASKED: Final = form("params" / Bytes(4))
TOLD: Final = form(
    "count" / Byte, Check((this.count >= 2) & (this.count <= 8)), "data" / Bytes(this.count)
)
PLANS: Final = ((plan_of(ASKED), REQUEST), (plan_of(TOLD), RESPONSE))
ASK: Final = bytes.fromhex("01 03 00 40 00 02 C5 DF")
TELL: Final = bytes.fromhex("01 03 04 01 2C 00 5A BA 3D")
ENDS_IN_ZERO: Final = bytes.fromhex("01 03 04 0A 34 00 72 38 00")
"""What is before its last byte holds as well, and is as long as what asks."""


def framed(data: bytes, *, final: bool = True) -> tuple[list[tuple[int, int, int]], int]:
    block = Block(np.frombuffer(data, np.uint8), np.empty(0, np.int64), final)
    spans, decided = frame_by_plans(PLANS, block)
    rows = zip(spans.start.tolist(), spans.end.tolist(), spans.kind.tolist(), strict=True)
    return [*rows], decided


def test_each_form_is_framed_and_tells_who_speaks() -> None:
    assert framed(ASK + TELL + ASK)[0] == [(0, 8, REQUEST), (8, 17, RESPONSE), (17, 25, REQUEST)]


def test_of_two_forms_that_hold_at_one_byte_the_longer_one_is_it() -> None:
    assert framed(ENDS_IN_ZERO[:-1])[0] == [(0, 8, REQUEST)]
    assert framed(ASK + ENDS_IN_ZERO)[0] == [(0, 8, REQUEST), (8, 17, RESPONSE)]


def test_what_may_still_become_the_longer_form_is_not_judged_yet() -> None:
    assert framed(ENDS_IN_ZERO[:-1], final=False) == ([], 0)
    assert framed(ENDS_IN_ZERO, final=False)[0] == [(0, 9, RESPONSE)]


@given(data=st.data())
def test_what_is_decided_of_an_open_end_stays_so_whatever_comes(data: st.DataObject) -> None:
    parts = st.sampled_from([ASK, TELL, ENDS_IN_ZERO, ENDS_IN_ZERO[:-1], TELL[:5], b"\x03\x04"])
    said = b"".join(data.draw(st.lists(parts, max_size=6)))
    n = data.draw(st.integers(0, len(said)))
    early, decided = framed(said[:n], final=False)
    assert early == [frame for frame in framed(said)[0] if frame[1] <= decided]
