"""What servos do, measure and say against it."""
