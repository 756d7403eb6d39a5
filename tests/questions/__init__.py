"""What engineers ask of captures: one command answers it, and so do the rows, apart from it."""
