"""Decoded records as plots of Rerun."""
