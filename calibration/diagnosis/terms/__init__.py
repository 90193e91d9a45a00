"""The diagnosis as a search among structures of Gaussian terms."""
