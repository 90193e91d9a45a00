"""What the environment does to a machine that stands still."""
