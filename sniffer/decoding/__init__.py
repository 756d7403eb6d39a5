"""Bytes and times in, records out: nothing here opens, prints, sleeps or asks for the time."""
