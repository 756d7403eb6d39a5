"""The messages that recordings hold, generated from ``schemas/messages`` by ``make schemas``."""
