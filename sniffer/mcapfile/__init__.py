"""MCAP recordings: written, read, rotated and mended."""
