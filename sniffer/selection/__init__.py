"""Which records are shown, and which part of a capture: the same words wherever something is read.

``Selection.parse("servo_id = 3 AND op = 'read'")`` reads a strict subset of SQL's WHERE;
``.rows(bus, protocol, batch)`` tells which rows of a batch it means. Places in a capture, such as
``10min`` or ``@first-error``, are in ``places``. There is no I/O here.
"""
