"""The packet family: protocols of one packet form, each a declaration and nothing else.

Header, id, length, code, parameters, checksum: mightyZAP, Dynamixel, LK-TECH. From a
``PacketFamily`` come framing and description in columns, values, words, and the oracle.

    Packet  ->  plan (ground)       framing in columns
    params  ->  shape (walk)        what a packet is, by code and count, in columns
    params  ->  parsed (slow)       the same one at a time, for the reference decoder
    both    ->  leaves (words)      fields, dissection, explanations of gaps
"""

from __future__ import annotations

from sniffer.ground.codes import IF_ALL, IF_READ, MANY, MUST, NEVER, OPTIONAL
from sniffer.ground.model import RELEASES, RESETS, STAGED
from sniffer.ground.wire import BY_CODE, AllBut, Packet, Seal
from sniffer.protocols.packets.declare import ANY, Command, PacketFamily, Stuffing
from sniffer.protocols.packets.member import Member

__all__ = [
    "ANY",
    "BY_CODE",
    "IF_ALL",
    "IF_READ",
    "MANY",
    "MUST",
    "NEVER",
    "OPTIONAL",
    "RELEASES",
    "RESETS",
    "STAGED",
    "AllBut",
    "Command",
    "Member",
    "Packet",
    "PacketFamily",
    "Seal",
    "Stuffing",
]
