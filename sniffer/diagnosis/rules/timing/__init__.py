"""When things are said: cycles, stalls, slow answers, and lines that were not free yet."""
