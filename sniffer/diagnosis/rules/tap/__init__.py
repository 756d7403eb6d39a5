"""What the tap does to a capture: what it loses, joins, swaps or takes for text."""
