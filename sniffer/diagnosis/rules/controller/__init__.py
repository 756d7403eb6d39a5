"""What the controller asks and writes that it should not, and how it waits."""
