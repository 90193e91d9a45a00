"""Observations as a sum of Gaussian terms: error motions, causes, functions without a name, and noise."""
