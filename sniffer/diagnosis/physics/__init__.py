"""What a UART hears: misread bits, two senders at once, a clock that is off."""
