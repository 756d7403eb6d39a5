"""Levels of wires -> bytes: what a logic analyser saw, read as a UART would, without any I/O.

Readers of file formats (``sources/``) turn what they find into stretches: for each channel the
times at which its level changed. From there all formats go one way: short pulses are left out
(``glitches``), the length of a bit, the polarity and the parity are found (``rates``), edges
become bytes (``uart``), it is told which channels carry any (``channels``), and bytes that stand
where the rate has them become chunks (``chunking``). Each step works in columns and takes a capture
stretch by stretch: recordings are larger than memory.
"""
