"""The commands of the history of machines."""
