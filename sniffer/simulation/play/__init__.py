"""A simulated bus on a port, in real time: pseudo-terminals, a clock, and the truth in a file.

``sniffer/simulation`` says what is on the line and when; here it is put there.
"""
