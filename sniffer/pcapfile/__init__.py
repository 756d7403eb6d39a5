"""Captures in pcap and pcapng: what Wireshark and its kin write and read."""
