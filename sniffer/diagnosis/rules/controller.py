"""What the controller says that it should not: goals, writes, forms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from sniffer.diagnosis.catalogue import FindingCode
    from sniffer.diagnosis.rules import Rule

FINDINGS: Final[tuple[FindingCode, ...]] = ()

RULES: Final[tuple[Rule, ...]] = ()
