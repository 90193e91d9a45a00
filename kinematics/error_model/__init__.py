"""The error model and its file."""
