"""Simulated servos and controllers of many habits on one line: devices and controllers at fault."""
