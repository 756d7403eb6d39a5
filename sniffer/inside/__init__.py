"""A capture looked into on a terminal: its frames, the fields of one, its bytes."""
