"""What is remembered of a bus, in bounded memory: traffic by servo and time, and what is rare."""
