"""Batches as plain tuples: the kit's, under the name that tests know."""

from sniffer.testing.records import asked_at, batches, gaps, records

__all__ = ["asked_at", "batches", "gaps", "records"]
