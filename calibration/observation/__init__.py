"""The observation equations: expected observations of an erring machine, and their derivatives."""
