"""Another generator of conversations for the diagnosis: ``python -m bench.other``."""
