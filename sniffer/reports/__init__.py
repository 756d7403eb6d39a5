"""What is left of a capture when it is over: a page to hand on, and verdicts on rules."""
