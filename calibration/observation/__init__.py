"""The observation equations: expected observations of a machine with errors, and their derivatives."""
