"""Recording from ports: the worker between the reader thread and the pipeline."""
