"""Recordings that speak: the line as it was, its servos, or its controller, on a port."""
