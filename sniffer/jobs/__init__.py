"""Whole jobs, each a call."""
