"""Tests of the unexplained residual."""
