"""What the diagnosis says of faults that were built in: scenarios, hosts, judges, figures."""
