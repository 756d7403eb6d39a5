"""Wireshark's side of it: a dissector, a profile, a capture interface, and their places."""
