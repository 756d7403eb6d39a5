"""What is wrong with a bus and why: findings over a whole capture, incidents, causes weighed.

``Diagnosis`` is a sink; it keeps a ``Ledger`` a bus, and judges it when asked.
"""

from __future__ import annotations

from sniffer.diagnosis.diagnosis import Diagnosis
from sniffer.diagnosis.model import Finding, Incident, Place, Ranked

__all__ = ["Diagnosis", "Finding", "Incident", "Place", "Ranked"]
