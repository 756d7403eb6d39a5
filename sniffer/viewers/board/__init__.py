"""The board: what every servo says now, on a terminal."""
