"""What rules ask of a case: whose it is, whether it is chance, what a servo was told."""
