"""NC programs in; corrected programs out; the command line."""
