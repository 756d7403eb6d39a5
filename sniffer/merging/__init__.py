"""Two taps, one for each direction, put in the order in which the bus spoke."""
