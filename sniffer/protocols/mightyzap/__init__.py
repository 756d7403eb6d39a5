"""IRROBOT mightyZAP linear servos (L12 family, 12Lf): a member of the packet family."""

from __future__ import annotations

from typing import Final

from sniffer.protocols.mightyzap.grammar import FAMILY
from sniffer.protocols.packets import Member

PROTOCOL: Final = Member(FAMILY)
