"""What is damaged on the line, by whom and when, and what else is said there."""
