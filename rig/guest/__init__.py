"""What runs inside the machine: the agent that obeys, adapters in software, small programs."""
