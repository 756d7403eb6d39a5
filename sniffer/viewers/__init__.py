"""What people look at while, or after, a bus is recorded."""
